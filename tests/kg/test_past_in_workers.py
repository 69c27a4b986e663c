"""A state of the past, made of a copy of the map: undone or written anew, it is the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pyoxigraph import Store

from kg.errors import HistoryError
from kg.records import MapUpdate
from kg.semantic_map import SemanticMap
from kg.workers import past

ANEW, UNDONE = -1.0, 2.0


@pytest.mark.parametrize("much", [ANEW, UNDONE])
def test_a_past_state_is_what_the_map_says_it_was(
    written: Callable[[int], SemanticMap],
    frame: Callable[..., MapUpdate],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    much: float,
) -> None:
    monkeypatch.setattr(past, "_MUCH", much)
    with written(8) as semantic_map:
        known = "{ GRAPH graph:commonsense { here:Cup here:isA here:Chair } }"
        semantic_map.update(f"INSERT DATA {known}", allow=("commonsense",))
        semantic_map.apply(frame(8, removed=(f"{semantic_map.base}object/2",)))
        semantic_map.update(f"DELETE DATA {known}", allow=("commonsense",))
        asked = {"log": str(semantic_map.history.file), "base": semantic_map.base}
        for number in (0, 1, 5, 9, 10, 11):
            folder = tmp_path / f"at-{number}"
            semantic_map.store.native.backup(str(folder))
            copy = Store(str(folder))
            past.make_past(copy, {**asked, "sequence": number})
            with semantic_map.at(number) as then:
                assert set(copy) == set(then.engine), number
        semantic_map.compact(keep=0.0)
        with pytest.raises(HistoryError, match="no longer kept"):
            past.make_past(copy, {**asked, "sequence": 3})
