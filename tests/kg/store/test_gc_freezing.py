"""Objects that a live writer has loaded are exempt from garbage collection."""

from __future__ import annotations

import gc
import weakref

import pytest

from kg.store.gc_freezing import gc_frozen


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
