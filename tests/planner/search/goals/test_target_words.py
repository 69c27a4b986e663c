from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UndetectableError, UnknownCategoryError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from mapping.looks.word_looks import Alike
from planner.search.goals.known_objects import known_objects
from planner.search.goals.search_goals import resolve_target
from planner.search.goals.target_words import AlikeHere
from planner.search.goals.targets import resolve, undetectable_target


def add_object(semantic_map: SemanticMap, label: str, x: float) -> None:
    iri = semantic_map.catalogue.find(label, "object").iri
    p_map = np.array([x, 1.0, 0.9])
    new = semantic_map.new_object_iri()
    semantic_map.apply(MapUpdate(objects=(ObjectRecord(new, iri, p_map, 2.0, 0.8, 3, 0.0, 1.0),)))


def add_corridor(semantic_map: SemanticMap) -> None:
    corridor = semantic_map.catalogue.find("corridor", "place").iri
    record = PlaceRecord(
        semantic_map.place_iri(3), "place 3", 0.0, 4.0, 0.0, 2.0, views=9, beliefs={corridor: 0.9}
    )
    semantic_map.apply(MapUpdate(places=(record,)))


def test_a_word_inside_a_category_searches_for_it_and_says_so(semantic_map: SemanticMap) -> None:
    add_object(semantic_map, "cup", 1.0)
    (target,) = resolve(semantic_map, ["coffee mug"])
    assert (target.label, target.note) == ("cup", "'coffee mug' means cup")
    assert len(known_objects(semantic_map, target)) == 1


def test_a_word_of_several_categories_searches_for_all_of_them(semantic_map: SemanticMap) -> None:
    add_object(semantic_map, "spoon", 1.0)
    add_object(semantic_map, "fork", 2.0)
    add_object(semantic_map, "cup", 2.0)
    (target,) = resolve(semantic_map, ["cutlery"])
    found = {one.category for one in known_objects(semantic_map, target)}
    assert (target.label, found) == ("cutlery", {"spoon", "fork"})
    with pytest.raises(UnknownCategoryError, match="fork, knife or spoon; ask for one of them"):
        resolve_target(semantic_map.catalogue, "cutlery")


def test_a_thing_that_no_detector_sees_is_answered_by_its_usual_places(semantic_map):
    add_corridor(semantic_map)
    answer = undetectable_target(semantic_map, "my keys")
    assert answer is not None
    assert answer.answer == (
        "No detector here can see things called 'my keys'. They are usually on a table or on a "
        "hook in the corridor or kitchen. This map has a corridor"
    )
    with pytest.raises(UndetectableError, match="This map has a corridor"):
        resolve(semantic_map, ["my keys"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("dishwasher", "They are usually in the kitchen (60 % of 7 such rooms have one)"),
        ("trash can", "They are most often on the floor in the kitchen (41 % of 29 activities"),
        ("guitar", "They are perhaps in the home office (18 % of 1 activities with one)"),
        ("mattress", "They are parts of a bed; search for that"),
        ("kettel", "'kettel' is read as kettle. No detector here can see things called 'kettle'"),
        ("Schl\u00fcssel", "No detector here can see things called 'Schl\u00fcssel' (keys)"),
        ("accordion", "Nothing is known about where they usually are"),
        ("milk", "No detector here can see things called 'milk'."),
    ],
)
def test_the_answer_has_counts_and_says_where_nothing_is_known(semantic_map, text, said):
    answer = undetectable_target(semantic_map, text)
    assert answer is not None
    assert said in answer.answer
    assert answer.to_json()["answer"] == answer.answer + "."


@pytest.mark.parametrize("text", ["cup", "something to drink", "kitchen", "qwzx", "cutlery"])
def test_other_texts_are_no_undetectable_things(semantic_map: SemanticMap, text: str) -> None:
    assert undetectable_target(semantic_map, text) is None


@pytest.mark.parametrize(
    ("alike", "said"),
    [
        (
            ("object/1 (book)", "object/2 (cup)"),
            "object/1 (book) and object/2 (cup) look most like it",
        ),
        (("object/1 (book)",), "Of the things in this map, object/1 (book) looks most like it"),
        ((), "Nothing with a picture in this map looks like it"),
        (None, "No detector here can see things called 'wallet'"),
    ],
)
def test_what_looks_like_an_unseen_thing_is_a_suggestion(semantic_map, alike, said):
    answer = undetectable_target(semantic_map, "wallet")
    assert answer is not None
    shown = None if alike is None else AlikeHere(Alike(()), alike)
    assert said in replace(answer, alike=shown).answer
    assert answer.alike is None  # a map in memory has no pictures
