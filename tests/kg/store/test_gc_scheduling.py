"""A live map is not interrupted by collections of what stays anyway."""

from __future__ import annotations

import gc
import sys
import weakref

import pytest

from kg.store import gc_scheduling as pauses
from kg.store.gc_scheduling import settled


def test_what_is_loaded_is_spared_for_the_length_of_the_block() -> None:
    before = gc.get_freeze_count()
    mine = [[]]
    with pytest.raises(KeyError), settled():
        assert gc.get_freeze_count() > before
        assert all(found is not mine for found in gc.get_objects())
        raise KeyError
    assert any(found is mine for found in gc.get_objects())


def test_what_came_since_is_spared_too_once_it_has_lasted() -> None:
    with settled():
        mine = [[]]
        gc.collect(1)
        assert all(found is not mine for found in gc.get_objects())
    assert any(found is mine for found in gc.get_objects())


def test_rings_that_stayed_behind_are_collected_when_they_are_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pauses, "LEFT", -sys.maxsize)
    with settled():
        rings = [_Ring() for _ in range(1000)]
        last = weakref.ref(rings[-1])
        gc.collect(1)
        rings.clear()
        gc.collect()
        assert last() is not None  # spared: nobody goes through those
        for _ in range(pauses.ROUNDS):
            gc.collect(1)
        gc.collect()
        assert last() is None


class _Ring:
    def __init__(self) -> None:
        self.me = self
