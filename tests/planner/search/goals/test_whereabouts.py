"""Where an object is, in words, from what the graph holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord, Relation
from planner.search.goals.search_goals import whereabouts

BASE = "https://example.org/map/"


def put(
    semantic_map: SemanticMap,
    number: int,
    label: str,
    *relations: Relation,
    place: str | None = None,
) -> str:
    record = ObjectRecord(
        iri=f"{BASE}object/{number}",
        category=semantic_map.catalogue.find(label).iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        confidence=1.0,
        existence=0.9,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        place=place,
        relations=relations,
    )
    semantic_map.apply(MapUpdate(objects=(record,)))
    return record.iri


def kitchen(semantic_map: SemanticMap, label: str = "kitchen") -> str:
    place = PlaceRecord(f"{BASE}place/1", label, 0.0, 4.0, 0.0, 4.0)
    semantic_map.apply(MapUpdate(places=(place,)))
    return place.iri


def test_an_apple_in_a_bowl_on_a_table_in_the_kitchen(semantic_map: SemanticMap) -> None:
    room = kitchen(semantic_map)
    table = put(semantic_map, 3, "dining table", place=room)
    bowl = put(semantic_map, 4, "bowl", Relation("on", table, 0.9), place=room)
    apple = put(semantic_map, 5, "apple", Relation("inside", bowl, 0.8), place=room)
    assert whereabouts(semantic_map, apple) == "inside bowl 4 on dining table 3 in the kitchen"
    assert whereabouts(semantic_map, table) == "in the kitchen"


@pytest.mark.parametrize(
    ("label", "where"),
    [
        ("guest room", "in the guest room"),
        ("redkitchen", "in redkitchen"),
        ("Ann's room", "in Ann's room"),
        ("place 5", "in place 5"),
    ],
)
def test_names_of_places_take_no_article(semantic_map: SemanticMap, label: str, where: str) -> None:
    cup = put(semantic_map, 3, "cup", place=kitchen(semantic_map, label))
    assert whereabouts(semantic_map, cup) == where


def test_a_neighbour_is_named_where_nothing_carries_it(semantic_map: SemanticMap) -> None:
    room = kitchen(semantic_map, "place 1")
    couch = put(semantic_map, 3, "couch", place=room)
    ball = put(semantic_map, 4, "sports ball", Relation("beside", couch, 0.7), place=room)
    assert whereabouts(semantic_map, ball) == "beside couch 3 in place 1"


def test_improbable_relations_are_not_named(semantic_map: SemanticMap) -> None:
    table = put(semantic_map, 3, "dining table")
    cup = put(semantic_map, 4, "cup", Relation("on", table, 0.4))
    assert whereabouts(semantic_map, cup) == "at (1.0, 2.0) m"
    assert whereabouts(semantic_map, f"{BASE}object/9") == ""


def test_a_circle_of_relations_ends(semantic_map: SemanticMap) -> None:
    first, second = put(semantic_map, 3, "bowl"), put(semantic_map, 4, "bowl")
    put(semantic_map, 3, "bowl", Relation("on", second, 0.9))
    put(semantic_map, 4, "bowl", Relation("on", first, 0.9))
    assert whereabouts(semantic_map, first) == "on bowl 4 on bowl 3"


def test_what_is_on_a_thing_is_asked_for_and_explained(semantic_map: SemanticMap) -> None:
    table = put(semantic_map, 3, "dining table")
    cup = put(semantic_map, 4, "cup", Relation("on", table, 0.8))
    put(semantic_map, 5, "cup", Relation("on", table, 0.3))
    (row,) = semantic_map.query("related", object=table).records()
    assert (row["relation"], row["object"], row["probability"]) == ("on", cup, 0.8)
    assert len(semantic_map.query("related", object=table, least=0.0).rows) == 2
    (reason,) = semantic_map.history.explain("object/4")
    assert "on dining table 3" in reason.text
    (fact,) = semantic_map.history.explain("object/4 here:on")
    assert any("boxes of both objects" in step.text for _, step in fact.walk())


def test_an_asserted_support_is_named_at_once(semantic_map: SemanticMap) -> None:
    put(semantic_map, 3, "dining table")
    cup = put(semantic_map, 4, "cup")
    semantic_map.assertions.add(cup, "on", "object/3", by="ann")
    assert whereabouts(semantic_map, cup).startswith("on dining table 3")
    (record,) = semantic_map.perceived.objects((cup,))
    semantic_map.apply(MapUpdate(objects=(replace(record, relations=()),)))
    assert whereabouts(semantic_map, cup).startswith("on dining table 3")
