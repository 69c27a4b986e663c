"""Memory of a live writer: loaded objects are exempt from collection, freed memory is returned."""

from __future__ import annotations

import ctypes
import gc
import weakref

import pytest

from benchmarks.graph.ours import resident
from kg.store.process_memory import gc_frozen, trim_heap


def test_existing_objects_are_exempt_for_the_length_of_the_block() -> None:
    before = gc.get_freeze_count()
    mine = [[]]
    with pytest.raises(KeyError), gc_frozen():
        assert gc.get_freeze_count() > before
        assert all(found is not mine for found in gc.get_objects())
        raise KeyError
    assert any(found is mine for found in gc.get_objects())


def test_cycles_that_are_made_later_are_collected() -> None:
    with gc_frozen():
        last = weakref.ref(_Cycle())
        gc.collect()
        assert last() is None


class _Cycle:
    def __init__(self) -> None:
        self.me = self


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
