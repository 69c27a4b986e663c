"""What moved, what left and what stands between: of a flat that is mapped twice."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.export.plain_documents import rooms_document
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.records import DepartedRecord, MapUpdate
from kg.serving.opening import create_map, in_memory_map
from planner.cli import main
from planner.search.goals.moves import moved_things
from tests.planner.flat import fill


def rearranged(semantic_map: SemanticMap) -> SemanticMap:
    """The flat, its cup carried to the bedroom, its bed pushed by 10 cm, its banana gone."""
    fill(semantic_map)
    banana, cup, bed = semantic_map.objects()
    gone = DepartedRecord(banana.iri, banana.category, banana.p_map, 0.9, 4, 5.0, 60.0, 120.0)
    carried = replace(cup, p_map=np.array([6.0, 2.0, 0.8]), place=semantic_map.place_iri(2))
    pushed = replace(bed, p_map=bed.p_map + np.array([0.1, 0, 0]))
    update = MapUpdate(objects=(carried, pushed), removed=(banana.iri,), departed=(gone,))
    semantic_map.apply(update)
    return semantic_map


def test_what_stands_elsewhere_moved_and_what_is_gone_or_was_pushed_did_not() -> None:
    with rearranged(in_memory_map()) as semantic_map:
        (cup,) = moved_things(semantic_map, "#1")
        assert (cup.category, cup.place) == ("cup", semantic_map.place_iri(2))
        assert cup.was.tolist() == [3.0, 1.0, 0.8] and cup.now.tolist() == [6.0, 2.0, 0.8]
        assert cup.metres == pytest.approx(10**0.5)
        assert [one.category for one in moved_things(semantic_map, "#1", far=0.05)] == [
            "cup",
            "bed",
        ]
        assert moved_things(semantic_map, "#1", "#1") == ()
        with pytest.raises(HistoryError):
            moved_things(semantic_map, "#99")


def test_last_seen_lists_what_left_too() -> None:
    with rearranged(in_memory_map()) as semantic_map:
        (banana,) = semantic_map.query("last-seen", category="food").records()
        assert (banana["category"], banana["place"]) == ("banana", "place 1")
        assert banana["lastSeen"].timestamp() == 60.0 and banana["foundGone"].timestamp() == 120.0
        (cup,) = semantic_map.query("last-seen", category="cup").records()
        assert (cup["foundGone"], cup["place"]) == (None, "place 2")
        (departed,) = rooms_document(semantic_map)["departed"]
        assert departed["category"] == "banana" and departed["last_seen"] == 60.0


def test_between_two_things_stand_those_on_the_strip_in_order() -> None:
    with fill(in_memory_map()) as semantic_map:
        banana, cup, bed = (one.iri for one in semantic_map.objects())
        wide = semantic_map.query("between", one=banana, other=bed, width=4.0).records()
        assert [row["object"] for row in wide] == [cup]
        assert wide[0]["distance"] == pytest.approx(14 / 37**0.5)
        assert semantic_map.query("between", one=banana, other=bed).rows == ()
        assert semantic_map.query("between", one=banana, other=cup, width=50.0).rows == ()
        assert semantic_map.query("between", one=bed, other=bed, width=50.0).rows == ()
        assert semantic_map.query("between", one=bed, other="object/99", width=50.0).rows == ()


def test_the_command_prints_what_moved(tmp_path: Path, capsys) -> None:
    path = tmp_path / "flat.map"
    rearranged(create_map(path, base="https://example.org/flat/")).close()
    assert main(["diff", str(path), "#1", "#2", "--moved", "--json"]) == 0
    (cup,) = json.loads(capsys.readouterr().out)
    assert cup == {
        "thing": "object/2",
        "category": "cup",
        "from": [3.0, 1.0, 0.8],
        "to": [6.0, 2.0, 0.8],
        "metres": 3.16,
    }
    assert main(["diff", str(path), "#1", "#2", "--moved"]) == 0
    assert "6.00, 2.00, 0.80" in capsys.readouterr().out
