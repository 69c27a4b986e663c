"""Where an object is, in words, from what the graph holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord, Relation
from kg.serving.opening import in_memory_map
from planner.search.goals.search_goals import whereabouts

BASE = "http://example.org/lab/"


@pytest.fixture
def chart() -> SemanticMap:
    return in_memory_map(base=BASE)


def put(
    chart: SemanticMap, number: int, label: str, *relations: Relation, place: str | None = None
) -> str:
    record = ObjectRecord(
        iri=f"{BASE}object/{number}",
        category=chart.catalogue.find(label).iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        confidence=1.0,
        existence=0.9,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        place=place,
        relations=relations,
    )
    chart.apply(MapUpdate(objects=(record,)))
    return record.iri


def kitchen(chart: SemanticMap, label: str = "kitchen") -> str:
    place = PlaceRecord(f"{BASE}place/1", label, 0.0, 4.0, 0.0, 4.0)
    chart.apply(MapUpdate(places=(place,)))
    return place.iri


def test_an_apple_in_a_bowl_on_a_table_in_the_kitchen(chart: SemanticMap) -> None:
    room = kitchen(chart)
    table = put(chart, 3, "dining table", place=room)
    bowl = put(chart, 4, "bowl", Relation("on", table, 0.9), place=room)
    apple = put(chart, 5, "apple", Relation("inside", bowl, 0.8), place=room)
    assert whereabouts(chart, apple) == "inside bowl 4 on dining table 3 in the kitchen"
    assert whereabouts(chart, table) == "in the kitchen"


def test_a_neighbour_is_named_where_nothing_carries_it(chart: SemanticMap) -> None:
    room = kitchen(chart, "place 1")
    couch = put(chart, 3, "couch", place=room)
    ball = put(chart, 4, "sports ball", Relation("beside", couch, 0.7), place=room)
    assert whereabouts(chart, ball) == "beside couch 3 in place 1"


def test_improbable_relations_are_not_named(chart: SemanticMap) -> None:
    table = put(chart, 3, "dining table")
    cup = put(chart, 4, "cup", Relation("on", table, 0.4))
    assert whereabouts(chart, cup) == "at (1.0, 2.0) m"
    assert whereabouts(chart, f"{BASE}object/9") == ""


def test_a_circle_of_relations_ends(chart: SemanticMap) -> None:
    first, second = put(chart, 3, "bowl"), put(chart, 4, "bowl")
    put(chart, 3, "bowl", Relation("on", second, 0.9))
    put(chart, 4, "bowl", Relation("on", first, 0.9))
    assert whereabouts(chart, first) == "on bowl 4 on bowl 3"


def test_what_is_on_a_thing_is_asked_for_and_explained(chart: SemanticMap) -> None:
    table = put(chart, 3, "dining table")
    cup = put(chart, 4, "cup", Relation("on", table, 0.8))
    put(chart, 5, "cup", Relation("on", table, 0.3))
    (row,) = chart.query("related", object=table).records()
    assert (row["relation"], row["object"], row["probability"]) == ("on", cup, 0.8)
    assert len(chart.query("related", object=table, least=0.0).rows) == 2
    (reason,) = chart.history.explain("object/4")
    assert "on dining table 3" in reason.text
    (fact,) = chart.history.explain("object/4 here:on")
    assert any("boxes of both objects" in step.text for _, step in fact.walk())


def test_an_asserted_support_is_named_at_once(chart: SemanticMap) -> None:
    put(chart, 3, "dining table")
    cup = put(chart, 4, "cup")
    chart.assertions.add(cup, "on", "object/3", by="ann")
    assert whereabouts(chart, cup).startswith("on dining table 3")
    (record,) = chart.perceived.objects((cup,))
    chart.apply(MapUpdate(objects=(replace(record, relations=()),)))
    assert whereabouts(chart, cup).startswith("on dining table 3")
