"""Freed memory goes back to the system."""

from __future__ import annotations

import sys

import pytest

from kg.bench.ours import resident
from kg.memory import give_back


@pytest.mark.skipif(sys.platform != "linux", reason="only glibc can be asked to")
def test_what_is_free_between_what_is_used_goes_back() -> None:
    pieces = [bytes(1000 + number % 5000) for number in range(40_000)]  # 140 MB
    kept = pieces[::7]
    del pieces
    before = resident()
    given = give_back()
    assert len(kept) == 5715
    if not given:
        pytest.skip("this C library does not give memory back")
    assert resident() < before - 50e6
