"""Known objects as goals, their whereabouts, and changes."""

import re
from dataclasses import replace

import numpy as np
import pytest

from kg.export.plain_documents import rooms_document
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord, PlaceRecord, Relation
from kg.serving.opening import in_memory_map
from planner.search.goals.known_objects import known_json, known_objects
from planner.search.goals.search_goals import whereabouts
from planner.search.goals.targets import resolve
from planner.search.plans.answer_sentences import answer_lines
from tests.planner.flat import fill


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


@pytest.mark.parametrize(
    ("word", "now", "change", "said"),
    [
        (
            "cup",
            10.0,
            {},
            "Probably at (1.0, 2.0) m: cup 1 was seen there 4 times, last just now "
            "(60 % sure); it may also be a bowl (30 %)",
        ),
        (
            "bowl",
            10.0,
            {},
            "Perhaps at (1.0, 2.0) m: cup 1, which may be a bowl, was seen there 4 times, "
            "last just now (30 % sure)",
        ),
        (
            "cup",
            70.0,
            {"existence": 0.49, "labels": {}, "observations": 1},
            "Perhaps at (1.0, 2.0) m: cup 1, which may be no cup, was seen there once, 60 s ago "
            "(49 % sure)",
        ),
    ],
)
def test_a_known_thing_is_said_with_its_doubts(chart, word, now, change, said):
    (cup,) = chart.objects()
    chart.apply(MapUpdate(objects=(replace(cup, **change),)))  # type: ignore[arg-type]
    assert line(chart, word, now) == said


def test_the_number_is_the_chance_that_it_is_still_there(chart: SemanticMap) -> None:
    day = 86400.0
    later = [line(chart, "cup", now) for now in (10.0, day / 3, day, 30 * day)]
    numbers = [float(re.findall(r"([\d.]+) %", text)[-1]) for text in later]
    assert numbers == sorted(numbers, reverse=True)
    assert later[1].startswith("Perhaps still at")
    assert later[3].startswith("Probably no longer at (1.0, 2.0) m: cup 1 was seen there 4 times, ")
    assert "last 30 days ago (still there with under 0.1 %)" in later[3]


def told(chart: SemanticMap, word: str) -> list[dict[str, object]]:
    (target,) = resolve(chart, [word])
    return known_json(target, known_objects(chart, target), 10.0)


def test_json_has_the_alternatives(chart: SemanticMap) -> None:
    (cup,) = told(chart, "cup")
    assert cup["may_be"] == [{"category": "bowl", "probability": 0.3}]
    (bowl,) = told(chart, "bowl")
    assert (bowl["category"], bowl["own_category"], bowl["existence"]) == ("bowl", "cup", 0.3)


BASE = "https://example.org/map/"


def put(semantic_map, number, label, *relations, place=None):
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
    ball = put(semantic_map, 6, "sports ball", Relation("beside", table, 0.7), place=room)
    unlikely = put(semantic_map, 7, "cup", Relation("on", table, 0.4))
    first, second = put(semantic_map, 8, "bowl"), put(semantic_map, 9, "bowl")
    put(semantic_map, 8, "bowl", Relation("on", second, 0.9))
    put(semantic_map, 9, "bowl", Relation("on", first, 0.9))
    said = {
        apple: "inside bowl 4 on dining table 3 in the kitchen",
        table: "in the kitchen",
        ball: "beside dining table 3 in the kitchen",
        unlikely: "at (1.0, 2.0) m",
        first: "on bowl 9 on bowl 8",  # a circle ends
        f"{BASE}object/99": "",
    }
    assert {iri: whereabouts(semantic_map, iri) for iri in said} == said
    for label in ("redkitchen", "Ann's room", "place 5", "guest room"):
        kitchen(semantic_map, label)
        article = "the " * (label == "guest room")
        assert whereabouts(semantic_map, table) == f"in {article}{label}"


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


def test_a_move_within_its_uncertainty_is_none_and_another_name_is_a_change() -> None:
    with fill(in_memory_map()) as semantic_map:
        _, cup, _ = semantic_map.objects()
        vague = replace(cup, p_map=cup.p_map + np.array([0.9, 0, 0]), deviation=0.5)
        semantic_map.apply(MapUpdate(objects=(vague,)))
        assert semantic_map.history.compare("#1").changes == ()
        semantic_map.assertions.add(cup.iri, "label", "the blue mug", by="ann")
        (named,) = semantic_map.history.compare("#1").changes
        assert (named.kind, named.sides[1]) == ("relabelled", "the blue mug")
        semantic_map.apply(MapUpdate(objects=(replace(vague, deviation=0.1),)))
        moved, _ = semantic_map.history.compare("#1").changes
        assert (moved.kind, moved.metres) == ("moved", pytest.approx(0.9))


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
