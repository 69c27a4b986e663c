"""What moved, what left and what stands between: of a flat that is mapped twice."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from kg.export.plain_documents import rooms_document
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.records import DepartedRecord, MapUpdate
from kg.serving.opening import create_map, in_memory_map
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


def test_what_changed_between_two_moments() -> None:
    with rearranged(in_memory_map()) as semantic_map:
        compare = semantic_map.history.compare
        gone, cup = compare("#1").changes
        assert (gone.kind, gone.category, gone.now) == ("gone", "banana", None)
        assert (cup.kind, cup.category, cup.place) == ("moved", "cup", "place/2")
        assert (cup.was, cup.now) == ((3.0, 1.0, 0.8), (6.0, 2.0, 0.8))
        assert cup.metres == pytest.approx(10**0.5)
        near = compare("#1", far=0.05).changes
        assert [one.category for one in near] == ["banana", "cup", "bed"]
        back = compare("#2", "#1").changes
        assert [(one.kind, one.category) for one in back] == [
            ("appeared", "banana"),
            ("moved", "cup"),
        ]
        assert compare("#1", "#1").changes == ()
        with pytest.raises(HistoryError):
            compare("#99")


def test_a_move_within_its_uncertainty_is_none() -> None:
    with fill(in_memory_map()) as semantic_map:
        _, cup, _ = semantic_map.objects()
        vague = replace(cup, p_map=cup.p_map + np.array([0.9, 0, 0]), deviation=0.5)
        semantic_map.apply(MapUpdate(objects=(vague,)))
        assert semantic_map.history.compare("#1").changes == ()
        sure = replace(vague, deviation=0.1)
        semantic_map.apply(MapUpdate(objects=(sure,)))
        (moved,) = semantic_map.history.compare("#1").changes
        assert moved.metres == pytest.approx(0.9)


def test_another_name_is_a_change() -> None:
    with fill(in_memory_map()) as semantic_map:
        _, cup, _ = semantic_map.objects()
        semantic_map.assertions.add(cup.iri, "label", "the blue mug", by="ann")
        (named,) = semantic_map.history.compare("#1").changes
        assert (named.kind, named.sides[1]) == ("relabelled", "the blue mug")


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


def test_the_command_prints_what_changed(tmp_path: Path, capsys) -> None:
    path = tmp_path / "flat.map"
    rearranged(create_map(path, base="https://example.org/flat/")).close()
    assert main(["diff", str(path), "#1", "#2", "--moved", "--json"]) == 0
    (cup,) = json.loads(capsys.readouterr().out)
    assert cup == {
        "change": "moved",
        "thing": "object/2",
        "category": "cup",
        "before": "3.00, 1.00, 0.80",
        "after": "6.00, 2.00, 0.80",
        "metres": 3.16,
    }
    assert main(["diff", str(path), "#1", "#2"]) == 0
    shown = capsys.readouterr()
    assert "6.00, 2.00, 0.80" in shown.out and "gone" in shown.out
    assert "m² of floor seen" in shown.err
