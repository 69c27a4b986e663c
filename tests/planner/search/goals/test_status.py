"""Status: present, gone, looked and none seen, hidden, never looked; and what proves it."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from hereabouts.cli import main
from kg.history.timestamps import spoken
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError
from kg.model.records import (
    DepartedRecord,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    PlaceViews,
    RecordingRecord,
)
from kg.model.transactions import Cause
from kg.serving.opening import create_map, in_memory_map
from planner.search.goals.status import status

SEEN = 1_700_000_000.0


def furnished(made: SemanticMap) -> SemanticMap:
    """Four places, viewed the less the later, and a cup in the second."""
    shares = (1.0, 0.5, 0.02)
    places = tuple(
        PlaceRecord(
            *(made.place_iri(n), name, 10.0 * n, 10.0 * n + 4, 0.0, 4.0),
            viewed=PlaceViews(share, share / 2, SEEN + 60),
        )
        for n, (name, share) in enumerate(zip(("kitchen", "hall", "den"), shares, strict=True))
    )
    attic = PlaceRecord(made.place_iri(3), "attic", 40.0, 44.0, 0.0, 4.0)
    made.apply(MapUpdate(objects=(thing(made, places[1]),), places=(*places, attic)))
    return made


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    with in_memory_map() as made:
        yield furnished(made)


def thing(semantic_map: SemanticMap, place: PlaceRecord, existence: float = 0.9) -> ObjectRecord:
    cup = semantic_map.catalogue.find("cup", "object").iri
    p = np.array([place.xmin + 1, 1.0, 0.8])
    iri = semantic_map.new_object_iri()
    return ObjectRecord(iri, cup, p, 3.0, existence, 5, SEEN - 9, SEEN, place.iri)


def values(semantic_map: SemanticMap, what: str) -> dict[str, str]:
    return {one.place_label: one.value for one in status(semantic_map, what).places}


def test_each_place_has_its_own_answer(semantic_map: SemanticMap) -> None:
    assert values(semantic_map, "cup") == {
        "kitchen": "looked, none seen",
        "hall": "present",
        "den": "never looked",
        "attic": "never looked",
    }
    assert values(semantic_map, "banana")["hall"] == "hidden"
    found = status(semantic_map, "cup")
    assert found.value == "present"
    assert f"in hall, 90 % sure, last seen {spoken(SEEN)}" in found.proof


def test_no_and_never_looked_are_different_answers(semantic_map: SemanticMap) -> None:
    looked = status(semantic_map, "banana", "kitchen")
    assert looked.value == "looked, none seen"  # it never was there, so it is not gone
    assert looked.proof.startswith("the robot viewed 100 % of the kitchen, last ")
    assert "out of view" not in looked.proof
    assert status(semantic_map, "banana", "place/2").value == "never looked"
    assert status(semantic_map, "banana", "HALL").value == "hidden"
    found = status(semantic_map, "banana")
    assert found.value == "hidden"
    assert "0 % of the attic" in found.proof
    with pytest.raises(QueryParameterError, match="there are: kitchen, hall, den, attic"):
        status(semantic_map, "banana", "cellar")
    assert status(semantic_map, "bananna").target == "banana"
    with pytest.raises(UnknownCategoryError, match="did you mean banana"):
        status(semantic_map, "bamama")


def test_a_large_thing_does_not_stand_where_little_is_out_of_view(semantic_map):
    hall = replace(semantic_map.places()[1], viewed=PlaceViews(0.8, 0.8, SEEN + 60))
    semantic_map.apply(MapUpdate(places=(hall,)))  # 3.2 of its 16 m2 are out of view
    found = {one: status(semantic_map, one, "hall") for one in ("spoon", "couch", "elephant")}
    chances = {one: round(answer.places[0].out_of_view, 2) for one, answer in found.items()}
    assert chances == {"spoon": 0.19, "couch": 0.0, "elephant": 0.0}
    assert found["spoon"].proof.endswith("the chance that one stood out of view is 19 %")
    assert found["couch"].proof.endswith("; no part out of view is large enough for one")
    values = [one.value for one in found.values()]
    assert values == ["hidden", "looked, none seen", "looked, none seen"]
    (row, *_) = semantic_map.query("status", category="couch", size=1.8, viewed=0.99).records()
    assert (row["placeLabel"], row["status"]) == ("kitchen", "looked, none seen")
    everywhere = status(semantic_map, "elephant")  # nobody looked in the attic, so one may be there
    assert everywhere.value == "hidden"
    assert everywhere.proof.endswith("is 100 %, most in the attic")


def test_what_left_the_map_is_gone_by_the_frame_that_showed_it(semantic_map: SemanticMap) -> None:
    (record,) = semantic_map.perceived.objects()
    short = record.iri.removeprefix(semantic_map.base)
    assert status(semantic_map, short).value == "present"
    doubted = replace(record, existence=0.2)
    semantic_map.apply(MapUpdate(objects=(doubted,)))
    assert status(semantic_map, short).value == "gone"  # its place was viewed since
    semantic_map.apply(MapUpdate(removed=(record.iri,)), Cause("frame", note="tour/frame-000042"))
    found = status(semantic_map, short)
    assert found.value == "gone"
    assert "tour/frame-000042" in found.proof
    with pytest.raises(QueryParameterError, match="knows nothing of object/77"):
        status(semantic_map, "object/77")


def test_a_thing_that_is_doubted_is_gone_only_if_its_place_was_viewed_since(semantic_map):
    kitchen, *_, attic = semantic_map.places()
    certain = thing(semantic_map, kitchen, existence=0.5)
    just_seen = replace(thing(semantic_map, kitchen, existence=0.4), last_seen=SEEN + 60)
    unviewed = thing(semantic_map, attic, existence=0.4)
    outside = replace(thing(semantic_map, attic, existence=0.4), place=None)
    semantic_map.apply(MapUpdate(objects=(certain, just_seen, unviewed, outside)))
    found = [status(semantic_map, one.iri) for one in (certain, just_seen, unviewed, outside)]
    assert [one.value for one in found] == ["present", "hidden", "hidden", "hidden"]
    assert "in the kitchen, 50 % sure" in found[0].proof
    assert "last viewed" not in found[0].proof
    assert f"kitchen last viewed {spoken(SEEN + 60)}" in found[1].proof
    assert found[3].proof.startswith("in no place, 40 % sure")


@pytest.mark.parametrize(
    ("peak", "seen", "after", "value"),
    [
        (0.9, 5, 60, "gone"),
        (0.7, 5, 60, "looked, none seen"),
        (0.9, 2, 60, "looked, none seen"),
        (0.9, 5, 5, "looked, none seen"),  # believed a few times, and refuted at the next look
        (0.9, 12, 5, "gone"),
    ],
)
def test_a_place_has_lost_only_what_was_really_there(semantic_map, peak, seen, after, value):
    bottle, iri = semantic_map.catalogue.find("bottle").iri, semantic_map.new_object_iri()
    spot, last = np.array([1.0, 1.0, 0.8]), SEEN + 60 - after
    left = DepartedRecord(iri, bottle, spot, peak, seen, SEEN - 9, last, SEEN + 60)
    semantic_map.apply(MapUpdate(departed=(left,), removed=(iri,)))
    assert values(semantic_map, "bottle")["kitchen"] == value
    own, found = status(semantic_map, iri), status(semantic_map, "bottle")
    assert own.value == value
    assert own.proof.startswith("left (1.00, 1.00) in the kitchen: last seen on 2023-11-1")
    assert own.proof.endswith(f"found gone {spoken(SEEN + 60)}")
    assert (found.value == "gone") == (value == "gone")
    assert (f"its spot was seen empty {spoken(SEEN + 60)}" in found.proof) == (value == "gone")


def test_no_detector_of_the_map_has_a_name_for_keys(semantic_map: SemanticMap) -> None:
    semantic_map.update(
        "INSERT DATA { GRAPH graph:ontology { here:Key a owl:Class ; rdfs:subClassOf here:Object ; "
        'rdfs:label "key" } }',
        allow=("ontology",),
    )
    assert status(semantic_map, "key", "kitchen").value == "looked, none seen"  # nothing is known
    cup = semantic_map.catalogue.find("cup", "object").iri
    seen = RecordingRecord("tour", 1, "frame-1", np.eye(4), detects=(cup,))
    semantic_map.apply(MapUpdate(recording=seen))
    found = status(semantic_map, "key")
    assert found.value == "never looked"
    assert found.proof.startswith("no detector that mapped here has a name for key")
    assert status(semantic_map, "banana", "kitchen").value == "never looked"
    assert values(semantic_map, "cup")["kitchen"] == "looked, none seen"


def test_what_no_category_includes_was_never_looked_for(semantic_map: SemanticMap) -> None:
    found = status(semantic_map, "my keys", "kitchen")
    assert (found.target, found.value, found.places) == ("my keys", "never looked", ())
    assert not found.detectable
    assert found.proof.startswith(
        "No detector here can see things called 'my keys'. They are usually on a table"
    )
    assert found.proof.endswith("This map has a kitchen")
    assert status(semantic_map, "cup").detectable


def test_a_kind_of_cup_counts_as_a_cup(semantic_map: SemanticMap) -> None:
    semantic_map.update(
        "INSERT DATA { GRAPH graph:ontology { here:Mug a owl:Class ; rdfs:subClassOf here:Cup ; "
        'rdfs:label "mug" } }',
        allow=("ontology",),
    )
    record = thing(semantic_map, semantic_map.places()[2])
    mug = replace(record, category=semantic_map.catalogue.find("mug", "object").iri)
    semantic_map.apply(MapUpdate(objects=(mug,)))
    assert values(semantic_map, "cup")["den"] == "present"
    assert values(semantic_map, "mug")["hall"] == "hidden"


def test_the_command_prints_answer_and_proof(tmp_path, capsys):
    path = tmp_path / "status.map"
    with create_map(path) as made:
        furnished(made)
    assert main(["status", str(path), "cup"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("cup: present. ")
    assert main(["status", str(path), "banana", "--in", "kitchen", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["value"] == "looked, none seen"
    assert told["places"][0]["noticed"] == pytest.approx(0.3)
    assert told["places"][0]["last_viewed"].startswith("2023-11-14T22:14:20")
    assert main(["status", str(path), "unicorn"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["status", str(path), "keys"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        "keys: never looked. No detector here can see things called 'keys'. They are usually on "
    )
    assert out.count("\n") == 1
    assert main(["status", str(path), "cup 99"]) == 1
    assert "nothing has the label 'cup 99'; there are: cup 1\n" in capsys.readouterr().err
