"""Known objects: what the map has of a target, and what may be one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from planner.search.goals.known_objects import answer_lines, known_json, known_objects
from planner.search.goals.targets import resolve


@pytest.fixture
def chart() -> SemanticMap:
    """A cup that may be a bowl."""
    chart = in_memory_map(base="http://example.org/lab/")
    cup, bowl = (chart.catalogue.find(label).iri for label in ("cup", "bowl"))
    record = ObjectRecord(
        iri=chart.new_object_iri(),
        category=cup,
        p_map=np.array([1.0, 2.0, 0.8]),
        confidence=1.8,
        existence=0.6,
        observations=4,
        first_seen=10.0,
        last_seen=10.0,
        labels={bowl: 0.3},
    )
    chart.apply(MapUpdate(objects=(record,)))
    return chart


def line(chart: SemanticMap, target: str) -> str:
    (text,) = answer_lines(known_objects(chart, resolve(chart, [target])[0]), now=10.0)
    return text.partition(", seen just now")[0]


def test_a_cup_that_may_be_a_bowl_says_so(chart: SemanticMap) -> None:
    assert line(chart, "cup") == (
        "cup 1: at (1.0, 2.0) m at (1.0, 2.0), existence 0.60, may also be a bowl (0.30)"
    )


def test_it_is_an_answer_for_bowls_too(chart: SemanticMap) -> None:
    assert line(chart, "bowl") == (
        "perhaps cup 1, which may be a bowl: at (1.0, 2.0) m at (1.0, 2.0), existence 0.30"
    )


def test_a_thing_that_is_hardly_there_has_its_alternatives_too(chart: SemanticMap) -> None:
    (cup,) = chart.objects()
    chart.apply(MapUpdate(objects=(replace(cup, existence=0.3, confidence=0.9),)))
    assert line(chart, "cup") == "Perhaps: a cup was seen 4 times at (1.0, 2.0)"
    (text,) = answer_lines(
        known_objects(chart, resolve(chart, ["cup"])[0]), now=10.0, address="lab.map"
    )
    assert text.endswith(
        "existence 0.30, may also be a bowl (0.30) (hereabouts why lab.map object/1)"
    )


def test_what_was_seen_once_is_said_to_be_so(chart: SemanticMap) -> None:
    (cup,) = chart.objects()
    chart.apply(MapUpdate(objects=(replace(cup, existence=0.49, labels={}, observations=1),)))
    (text,) = answer_lines(known_objects(chart, resolve(chart, ["cup"])[0]), now=70.0)
    assert text == (
        "Perhaps: a cup was seen once at (1.0, 2.0), last seen 60 s ago (1970-01-01 00:00:10), "
        "existence 0.49 (hereabouts why MAP object/1)"
    )


def test_json_has_the_alternatives(chart: SemanticMap) -> None:
    (cup,) = known_json(chart, resolve(chart, ["cup"]))
    assert cup["may_be"] == [{"category": "bowl", "probability": 0.3}]
    (bowl,) = known_json(chart, resolve(chart, ["bowl"]))
    assert (bowl["category"], bowl["own_category"], bowl["existence"]) == ("bowl", "cup", 0.3)
