"""Known objects: what the map has of a target, and what may be one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from planner.search.goals.known_objects import known_json, known_objects
from planner.search.goals.targets import resolve
from planner.search.plans.answer_sentences import answer_lines


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


def line(chart: SemanticMap, target: str, now: float = 10.0) -> str:
    (text,) = answer_lines(known_objects(chart, resolve(chart, [target])[0]), now)
    return text


def test_a_cup_that_may_be_a_bowl_says_so(chart: SemanticMap) -> None:
    assert line(chart, "cup") == (
        "Probably at (1.0, 2.0) m: cup 1 was seen there 4 times, last just now "
        "(probability there 0.60); it may also be a bowl (probability 0.30)"
    )


def test_it_is_an_answer_for_bowls_too(chart: SemanticMap) -> None:
    assert line(chart, "bowl") == (
        "Perhaps at (1.0, 2.0) m: cup 1, which may be a bowl, was seen there 4 times, "
        "last just now (probability there 0.30)"
    )


def test_a_thing_that_is_hardly_there_has_its_alternatives_too(chart: SemanticMap) -> None:
    (cup,) = chart.objects()
    chart.apply(MapUpdate(objects=(replace(cup, existence=0.3, confidence=0.9),)))
    assert line(chart, "cup") == (
        "Perhaps at (1.0, 2.0) m: cup 1, which may be no cup, was seen there 4 times, "
        "last just now (probability there 0.30); it may also be a bowl (probability 0.30)"
    )


def test_what_was_seen_once_is_said_to_be_so(chart: SemanticMap) -> None:
    (cup,) = chart.objects()
    chart.apply(MapUpdate(objects=(replace(cup, existence=0.49, labels={}, observations=1),)))
    assert line(chart, "cup", now=70.0) == (
        "Perhaps at (1.0, 2.0) m: cup 1, which may be no cup, was seen there once, 60 s ago "
        "(probability there 0.49)"
    )


def test_the_number_is_the_chance_that_it_is_still_there(chart: SemanticMap) -> None:
    day = 86400.0
    later = [line(chart, "cup", now) for now in (10.0, day / 3, day, 30 * day)]
    numbers = [float(text.split("there ")[2][:4]) for text in later]
    assert numbers == sorted(numbers, reverse=True)
    assert later[1].startswith("Perhaps still at")
    assert later[3].startswith("Probably no longer at (1.0, 2.0) m: cup 1 was seen there 4 times, ")
    assert "last 30 days ago (probability there 0.00)" in later[3]


def test_json_has_the_alternatives(chart: SemanticMap) -> None:
    (cup,) = known_json(chart, resolve(chart, ["cup"]), 10.0)
    assert cup["may_be"] == [{"category": "bowl", "probability": 0.3}]
    (bowl,) = known_json(chart, resolve(chart, ["bowl"]), 10.0)
    assert (bowl["category"], bowl["own_category"], bowl["existence"]) == ("bowl", "cup", 0.3)
