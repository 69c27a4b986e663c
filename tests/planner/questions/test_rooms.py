"""Plain questions about rooms, places and doors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.records import MapUpdate, PlaceViews
from kg.model.room_edit import RoomEdit
from planner.questions.answers import answer_box, answer_question
from tests.planner.flat import fill


@pytest.fixture
def flat(semantic_map: SemanticMap) -> Iterator[SemanticMap]:
    """A kitchen and a bedroom side by side, and a third room that may be a bathroom."""
    fill(semantic_map)
    kitchen, bedroom, third = semantic_map.places()
    find = semantic_map.catalogue.find
    beliefs = {find("bedroom", "place").iri: 0.5, find("bathroom", "place").iri: 0.3}
    viewed = PlaceViews(1.0, 1.0, 1000.0)
    changed = (
        replace(kitchen, viewed=viewed),
        replace(bedroom, label="Ann's room"),
        replace(third, beliefs=beliefs, views=5),
    )
    semantic_map.apply(MapUpdate(places=changed))
    yield semantic_map


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (
            "where is the kitchen?",
            ["Place 1 is believed to be a kitchen (probability 0.90): at (2.0, 2.0), "],
        ),
        ("kitchen", ["Place 1 is believed to be a kitchen (probability 0.90)"]),
        ("wheres Ann's room", ["Ann's room is believed to be a bedroom (probability 0.90)"]),
        ("where is place 3", ["Place 3 is believed to be a bedroom (probability 0.50)"]),
        ("what is place 3?", ["Place 3 is believed to be a bedroom (probability 0.50)"]),
        ("is there a kitchen?", ["Yes: place 1 is believed to be a kitchen (probability 0.90)"]),
        (
            "do we have a K\u00fcche",
            ["Yes: place 1 is believed to be a kitchen (probability 0.90)"],
        ),
        ("are there any bedrooms", ["Yes:", "Ann's room is", "Place 3 is"]),
        ("is there a room", ["Yes:", "Place 1 is", "Ann's room is", "Place 3 is"]),
        ("is there a bathroom", ["Perhaps a bathroom: place 3 (probability 0.30)"]),
        ("is there a pantry", ["No place of this map is believed to be a pantry; the map has pla"]),
        (
            "do we have a garage",
            ["No place of this map is believed to be a garage; the map has place"],
        ),
        ("is place 1 a kitchen", ["Yes: place 1 is believed to be a kitchen (probability 0.90)"]),
        ("is place 1 a bedroom", ["No: place 1 is believed to be a kitchen (probability 0.90)"]),
        (
            "is place 3 a bathroom",
            ["No: place 3 is believed to be a bedroom (probability 0.50), and a bath"],
        ),
        ("how many kitchens are there", ["kitchen: 1, the kitchen"]),
        (
            "how many bathrooms do we have",
            ["bathroom: 0", "Perhaps a bathroom: place 3 (probability 0.30)"],
        ),
        (
            "when did you last see the kitchen",
            ["90 s ago: the kitchen, at 1970-01-01T00:16:40"],
        ),
        ("when did you last see the bedroom", ["It is not kept when bedroom was last viewed"]),
        ("what is next to the kitchen", ["Next to the kitchen: Ann's room (bedroom)"]),
        (
            "is there a bedroom next to the kitchen",
            ["Yes: Ann's room (bedroom) is next to the kitchen"],
        ),
        ("is there a pantry next to the kitchen", ["No place of this map is believed to be a pan"]),
        (
            "is the bedroom next to the kitchen?",
            ["Yes: Ann's room (bedroom) is next to the kitchen"],
        ),
        (
            "which rooms are next to Ann's room",
            [
                "Next to Ann's room (bedroom): the kitchen",
                "Next to Ann's room (bedroom), with no known door: place 3",
            ],
        ),
        (
            "is the kitchen next to place 3",
            ["Not as far as the map knows", "Next to place 3 (bedroom), with no known door: Ann"],
        ),
        ("is the kitchen bigger than Ann's room", ["The kitchen has 16.0 m2, Ann's room"]),
        ("how many doors are there", ["1 door"]),
        (
            "is there a door in the kitchen",
            ["Yes, 1 door of place 1:", "Between place 1 and Ann's"],
        ),
        ("where is the door", ["Between place 1 and Ann's room, at (4.0, 2.0), 0.8 m"]),
        ("what is in the K\u00fcche", ["2 objects in the kitchen: a banana, a cup"]),
        ("gibt es ein Badezimmer?", ["Perhaps a bathroom: place 3 (probability 0.30)"]),
        ("Wo ist die Kueche", ["Place 1 is believed to be a kitchen (probability 0.90)"]),
        ("was ist in der K\u00fcche?", ["2 objects in the kitchen: a banana, a cup"]),
        ("welche R\u00e4ume gibt es", ["3 places: place 1 (kitchen)"]),
        ("which rooms are there", ["3 places: place 1 (kitchen), Ann's room (bedroom), place 3"]),
    ],
)
def test_rooms_are_things_to_ask_for(flat: SemanticMap, question: str, answer: list[str]) -> None:
    flat.rooms.edit(RoomEdit("door", ("place/1", "place/2"), ((4.0, 2.0),)), by="ann")
    lines = answer_question(flat, question, now=1090.0).lines
    assert len(lines) == len(answer), lines
    for line, begins in zip(lines, answer, strict=True):
        assert line.startswith(begins)


@pytest.mark.parametrize(
    ("question", "says"),
    [
        ("where is place 9", "no place is called 'place 9'; there are: place 1, Ann's room"),
        ("is there a cup near the kitchen", "'what is in the kitchen' would work"),
        ("what is in the garage", "no place is called 'garage'; there are: place 1"),
    ],
)
def test_a_room_that_is_none_is_told(flat: SemanticMap, question: str, says: str) -> None:
    with pytest.raises(QueryParameterError) as refused:
        answer_question(flat, question)
    assert says in str(refused.value)


def test_a_map_without_doors_says_so(flat: SemanticMap) -> None:
    (line,) = answer_question(flat, "how many doors are there").lines
    assert line.startswith("Doors are not known")


def test_the_box_of_the_page_answers_for_rooms(flat: SemanticMap) -> None:
    told = answer_box(flat, ["where is the kitchen?"])
    assert str(told["answer"]).startswith(
        "['Place 1 is believed to be a kitchen (probability 0.90)"
    )
