"""Freed memory is returned to the system."""

from __future__ import annotations

import ctypes

import pytest

from benchmarks.graph.ours import resident
from kg.store.heap_trimming import trim_heap


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="only glibc can be asked to"
)
def test_free_memory_between_used_blocks_is_returned() -> None:
    pieces = [bytes(1000 + number % 5000) for number in range(40_000)]  # 140 MB
    kept = pieces[::7]
    del pieces
    before = resident()
    assert trim_heap()
    assert len(kept) == 5715
    assert resident() < before - 50e6
