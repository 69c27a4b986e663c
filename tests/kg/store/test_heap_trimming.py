"""Freed memory goes back to the system."""

from __future__ import annotations

import ctypes

import pytest

from benchmarks.graph.ours import resident
from kg.store.heap_trimming import give_back


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="only glibc can be asked to"
)
def test_what_is_free_between_what_is_used_goes_back() -> None:
    pieces = [bytes(1000 + number % 5000) for number in range(40_000)]  # 140 MB
    kept = pieces[::7]
    del pieces
    before = resident()
    assert give_back()
    assert len(kept) == 5715
    assert resident() < before - 50e6
