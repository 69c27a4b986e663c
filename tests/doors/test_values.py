"""Values of things: the same ones are taken and refused at every door that writes them."""

from dataclasses import asdict, replace
from typing import Any, get_args

import numpy as np
import pytest
import requests

from kg.maps.facts.assertions import NAME
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import MapUpdate
from kg.model.resources import ONTOLOGIES
from kg.model.room_edit import RoomEdit
from tests.doors.doors import PATIENCE, House, RefusedError, answered, command
from tests.doors.stating_doors import APPLYING, ASSERTING, RETRACTING, draw_beside_the_writer

CUP, KITCHEN = "object/2", "place/1"
#: thing, property, value, what the refusal says
REFUSED = (
    (CUP, "position", "1 2 1e200", "three finite numbers"),
    (CUP, "position", "nan 2 1", "three finite numbers"),
    (CUP, "extent", "1 0 1", "three lengths"),
    (CUP, "extent", "0.5 0.5 0.5 3.5", "a yaw of"),
    (CUP, "existence", "maybe", "present or absent"),
    (CUP, "category", "zorb", "zorb"),
    (CUP, "on", "zorb 3", "zorb 3"),
    (CUP, "note", "a note of places", "cannot be asserted"),
    (KITCHEN, "note", "x" * 101, "up to 100 characters"),
    (KITCHEN, "area", "POLYGON ((0 0, 4000000 0, 4 3, 0 0))", "metres in the map frame"),
    (KITCHEN, "position", "1 2 3", "cannot be asserted"),
)
#: thing, property, value, and the value that is kept
TAKEN = (
    (CUP, "extent", "0.5 0.4 0.3 0.2", "0.5 0.4 0.3 0.2"),
    (CUP, "on", "object/3", "object/3"),
    ("1", "note", "closed " + "x" * 93, "closed " + "x" * 93),
    ("kitchen", "area", "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))", "POLYGON"),
)


@pytest.mark.parametrize("door", ASSERTING)
def test_an_asserted_value_is_refused(house: House, door: str) -> None:
    before = house.map.sequence
    for thing, name, value, says in REFUSED:
        with pytest.raises(RefusedError, match=says):
            ASSERTING[door](house, thing, name, value)
    assert house.map.sequence == before


@pytest.mark.parametrize("door", ASSERTING)
def test_an_asserted_value_is_taken_and_taken_back(house: House, door: str) -> None:
    before = {quad.triple for quad in house.map.engine if quad.graph_name == v.MAP_GRAPH}
    for thing, name, value, kept in TAKEN:
        ASSERTING[door](house, thing, name, value)
        (made,) = (one for one in house.map.assertions.all() if one.property == name)
        assert kept in made.value
        RETRACTING[door](house, thing, name)
    assert {quad.triple for quad in house.map.engine if quad.graph_name == v.MAP_GRAPH} == before


@pytest.mark.parametrize("door", RETRACTING)
def test_a_thing_is_retracted_by_the_name_that_was_asserted_away(house: House, door: str) -> None:
    for thing, name, category in (("kitchen", KITCHEN, "bathroom"), ("the cup", CUP, "bowl")):
        house.map.assertions.add(name, "category", category, by="ann")
        with pytest.raises(RefusedError):
            ASSERTING["python"](house, thing, "label", "it is another one now")
        RETRACTING[door](house, thing, "category")
        assert house.map.assertions.all(name) == ()


DRAWING = {
    "python": lambda house, edit: house.map.rooms.edit(edit, by="ann"),
    "http": lambda house, edit: answered(
        requests.post(
            f"{house.server.url}rooms", json=asdict(edit), headers=house.bearer, timeout=PATIENCE
        )
    ),
    "beside the writer": draw_beside_the_writer,
}


@pytest.mark.parametrize("door", DRAWING)
@pytest.mark.parametrize("kind", ["draw", "split", "here"])
def test_a_room_is_called_what_a_label_may_be(house: House, door: str, kind: str) -> None:
    points = {"draw": ((20.0, 0.0), (22.0, 0.0), (22.0, 2.0)), "split": ((6.0, -1.0), (6.0, 5.0))}
    places = ("place/2",) if kind == "split" else ()
    before = house.map.sequence
    for name, says in (
        ("x" * 101, "up to 100 characters"),
        ("a\u202eb", "visible characters"),
        ("a\nb", "one line"),
        ("place/1", "is the id of a thing"),
    ):
        with pytest.raises((RefusedError, InvalidFactError), match=says):
            DRAWING[door](house, RoomEdit(kind, places, points.get(kind, ()), name))
    assert house.map.sequence == before


#: a changed field of a record, and what the refusal says
NO_RECORD: tuple[tuple[dict[str, Any], str], ...] = (
    ({"p_map": np.array([1e200, 1.0, 1.0])}, "position"),
    ({"p_map": np.array([1.0, 1.0, np.nan])}, "position"),
    ({"extent": np.array([1.0, 1e7, 1.0])}, "extent must be within|has a side of"),
    ({"extent": np.array([1.0, 1.0, 1.0]), "yaw": 4.0}, "yaw must be within"),
    ({"deviation": 1e200}, "deviation must be within"),
    ({"existence": 1.5}, "existence must be within"),
    ({"observations": 10**16}, "observations must be"),
    ({"last_seen": 1e12}, "years 1 to 9999"),
    ({"category": f"{v.HERE}Zorb"}, "Zorb"),
    ({"iri": "https://example.org/maps/house/object/a b"}, "a b"),
)


@pytest.mark.parametrize("door", APPLYING)
def test_a_record_beyond_a_limit_is_refused(house: House, door: str) -> None:
    house.map.assertions.add("object/1", "label", "fruit", by="ann")
    (cup,) = (one for one in house.map.objects() if one.iri == house.map.base + CUP)
    before = house.map.sequence
    for fields, says in NO_RECORD:
        with pytest.raises(RefusedError, match=says):
            APPLYING[door](house, MapUpdate((replace(cup, **fields),)))
    assert house.map.sequence == before
    house.map.assertions.retract("object/1", "label", by="ann")


def test_the_shapes_allow_the_asserted_properties() -> None:
    text = (ONTOLOGIES / "shapes.ttl").read_text(encoding="utf-8")
    kept = [name for name in get_args(v.AssertedProperty) if name != NAME]
    assert f'"^({"|".join(kept)})$"' in text


def test_a_search_has_the_time_of_a_transaction(house: House) -> None:
    """--now takes what --at takes."""
    for when in ("#1", "1", "2030-01-01", "now"):
        assert "cup" in command("find", house.folder, "cup", "--from", "6,1", "--now", when)
    with pytest.raises(RefusedError, match="no transaction #999"):
        command("find", house.folder, "cup", "--from", "6,1", "--now", "#999")
