"""Rooms that persons draw, and outlines of places."""

import math

import numpy as np
import pytest

from hereabouts.cli import main
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import area_of
from kg.model.errors import InvalidFactError, ShapeError
from kg.model.records import DoorRecord, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.model.room_edit import RoomEdit
from kg.serving.opening import create_map, in_memory_map

KITCHEN, HALL = "place/1", "place/2"


@pytest.fixture
def home(tmp_path):
    """Two rooms of 4 m x 3 m with a wall of 0.2 m between them; a cup in each half of the first."""
    with create_map(tmp_path / "home.map", base="http://m/") as made:
        cup = made.catalogue.find("cup", "object").iri
        cups = [
            ObjectRecord(
                *(made.new_object_iri(), cup, np.array([x, 1.0, 0.8])),
                *(1.0, 0.8, 1, 1.0, 1.0, made.place_iri(1)),
            )
            for x in (1.0, 3.5)
        ]
        rooms = (
            PlaceRecord(made.place_iri(1), "kitchen", 0.0, 4.0, 0.0, 3.0, from_floor=True),
            PlaceRecord(made.place_iri(2), "hall", 4.2, 8.0, 0.0, 3.0, from_floor=True),
        )
        made.apply(MapUpdate(objects=tuple(cups), places=rooms))
        yield made


def areas(semantic_map):
    return {place.label: place.area for place in semantic_map.places()}


def places_of_objects(semantic_map):
    return [record.place.removeprefix(semantic_map.base) for record in semantic_map.objects()]


def split(points=((3.0, 0.5), (3.0, 2.0)), name="pantry"):
    return RoomEdit("split", (KITCHEN,), points, name)


def test_a_split_gives_the_smaller_part_to_a_new_place(home):
    change = home.rooms.edit(split(), by="ann")
    assert (change.cause.kind, change.cause.by) == ("rooms", "ann")
    assert areas(home)["kitchen"].area == pytest.approx(9.0)
    assert areas(home)["pantry"].area == pytest.approx(3.0)
    assert places_of_objects(home) == ["place/1", "place/3"]
    claims = {(a.subject.removeprefix(home.base), a.property, a.by) for a in home.assertions.all()}
    assert claims == {("place/1", "area", "ann"), ("place/3", "area", "ann")}


def test_edits_are_undone_one_by_one(home):
    before = home.places(), places_of_objects(home)
    home.rooms.edit(split(), by="ann")
    home.rooms.edit(RoomEdit("merge", ("place/3", HALL)), by="ann")
    assert set(areas(home)) == {"kitchen", "pantry"}
    home.rooms.edit(RoomEdit("undo"), by="ann")
    assert set(areas(home)) == {"kitchen", "pantry", "hall"}
    home.rooms.edit(RoomEdit("undo"), by="ann")
    assert (home.places(), places_of_objects(home)) == before
    assert not home.assertions.all()
    with pytest.raises(InvalidFactError, match="no edit of rooms is left"):
        home.rooms.edit(RoomEdit("undo"), by="ann")


def test_merged_rooms_hold_the_wall_between_them_and_all_objects(home):
    home.rooms.edit(RoomEdit("merge", (HALL, KITCHEN)), by="ann")
    (hall,) = home.places()
    assert (hall.iri, hall.label) == (home.base + HALL, "hall")
    assert hall.area.area == pytest.approx(24.0, abs=0.05)
    assert places_of_objects(home) == [HALL, HALL]


def test_a_moved_wall_keeps_both_places(home):
    home.rooms.edit(RoomEdit("wall", (KITCHEN, HALL), ((3.0, 0.0), (3.4, 3.0))), by="ann")
    found = areas(home)
    assert found["kitchen"].area == pytest.approx(9.6, abs=0.05)
    assert found["hall"].area == pytest.approx(14.4, abs=0.05)
    assert places_of_objects(home) == [KITCHEN, HALL]


def test_a_drawn_place_takes_its_floor_from_others(home):
    corners = ((3.0, 0.0), (5.0, 0.0), (5.0, 2.0), (3.0, 2.0))
    home.rooms.edit(RoomEdit("draw", points=corners, name="corner"), by="ann")
    found = areas(home)
    assert found["corner"].area == pytest.approx(4.0)
    assert found["kitchen"].area == pytest.approx(10.0)
    assert found["hall"].area == pytest.approx(3.8 * 3 - 0.8 * 2)
    assert places_of_objects(home) == [KITCHEN, "place/3"]


def test_the_room_of_the_robot_is_named(home):
    edit = RoomEdit("here", name="room 315")
    with pytest.raises(InvalidFactError, match="no robot"):
        home.rooms.edit(edit, by="ann")
    home.apply(MapUpdate(robot=RobotRecord(np.array([5.0, 1.0, 1.4]), 0.0, 1.0)))
    home.rooms.edit(edit, by="ann")
    assert set(areas(home)) == {"kitchen", "room 315"}
    home.rooms.edit(RoomEdit("undo"), by="ann")
    assert set(areas(home)) == {"kitchen", "hall"}


def test_a_marked_door_says_who_marked_it(home):
    home.rooms.edit(RoomEdit("door", (HALL, KITCHEN), ((4.1, 1.5),)), by="ann")
    (door,) = home.doors()
    assert door == DoorRecord(
        "http://m/door/1-2",
        *(4.1, 1.5, 0.8),
        ("http://m/place/1", "http://m/place/2"),
        "http://m/agent/ann",
    )
    home.rooms.edit(RoomEdit("undo"), by="ann")
    assert not home.doors()


IMPOSSIBLE = (
    (lambda: split(((5.0, 0.0), (5.0, 3.0))), "does not divide kitchen in two"),
    (lambda: split(((1.0, 1.0), (1.0, 1.0))), "two points that are apart"),
    (lambda: RoomEdit("split", ("place/9",), ((0, 0), (1, 1))), "no place 'place/9'"),
    (lambda: RoomEdit("split", (KITCHEN, HALL), ((0, 0), (1, 1))), "1 different places"),
    (lambda: RoomEdit("merge", (KITCHEN, KITCHEN)), "2 different places"),
    (lambda: RoomEdit("fold"), "there are split, merge"),
    (lambda: RoomEdit("draw", points=((0, 0), (1, 1))), "3 points"),
    (lambda: RoomEdit("draw", points=((0, 0), (3, 1), (3, 0), (0, 2))), "crosses itself"),
    (lambda: RoomEdit("draw", points=((0, 0), (math.nan, 1), (1, 0))), "not finite"),
    (
        lambda: RoomEdit("draw", points=((-1, -1), (9, -1), (9, 9), (-1, 9))),
        "nothing of kitchen would be left",
    ),
    (lambda: RoomEdit("door", (KITCHEN, HALL), ((1.0, 1.5),)), "no door of hall"),
    (lambda: RoomEdit("here"), "needs the name"),
)


def test_an_edit_that_is_not_possible_changes_nothing(home):
    before = home.sequence
    for edit, message in IMPOSSIBLE:
        with pytest.raises(InvalidFactError, match=message):
            home.rooms.edit(edit(), by="ann")
    assert home.sequence == before


def test_an_area_can_be_asserted_and_retracted(home):
    home.assertions.add(KITCHEN, "area", "POLYGON ((0 0, 2 0, 2 3, 0 3, 0 0))", by="ann")
    assert areas(home)["kitchen"].area == pytest.approx(6.0)
    home.assertions.retract(KITCHEN, "area", by="ann")
    assert areas(home)["kitchen"].area == pytest.approx(12.0)
    with pytest.raises(InvalidFactError, match="POLYGON"):
        home.assertions.add(KITCHEN, "area", "round", by="ann")


def test_rooms_are_edited_by_command(home, tmp_path, capsys):
    home.close()
    folder = str(tmp_path / "home.map")
    command = ["rooms", folder, "split", KITCHEN, "--points", "3 -1, 3 4", "--name", "pantry"]
    assert main([*command, "--by", "ann"]) == 0
    assert "place/3 pantry: 3.0 m2 (new)" in capsys.readouterr().err
    assert main(["rooms", folder, "undo", "--by", "ann"]) == 0
    assert "place/3 pantry: removed" in capsys.readouterr().err
    assert main(["rooms", folder, "undo", "--by", "ann"]) == 1
    assert "no edit of rooms is left to undo" in capsys.readouterr().err


BASE = "http://m/"
PLACE = f"{BASE}place/1"
L_SHAPE = area_of([[(0, 0), (6, 0), (6, 2), (2, 2), (2, 5.004), (0, 5.004)]])
ROUND = area_of([[(0, 0), (6, 0), (6, 2), (2, 2), (2, 5), (0, 5)]])


@pytest.fixture
def flat():
    with in_memory_map(base=BASE) as made:
        hall = PlaceRecord(PLACE, "hall", 0, 1, 0, 1).with_area(L_SHAPE)
        room = PlaceRecord(f"{BASE}place/2", "room", 2, 6, 2, 5)
        robot = RobotRecord(np.array([4.0, 4.0, 1.0]), 0.0, 1.0)
        made.apply(MapUpdate(places=(hall, room), robot=robot))
        yield made


def outline(semantic_map: SemanticMap) -> list[str]:
    table = semantic_map.query(
        f"SELECT ?o WHERE {{ GRAPH graph:map {{ <{PLACE}> here:outline ?o }} }}"
    )
    return [str(row[0]) for row in table.rows]


def test_an_outline_is_read_as_it_was_written_to_a_centimetre(flat):
    hall, room = flat.places()
    assert hall.area == ROUND
    assert room.outline == ()
    assert outline(flat) == [f"<{BASE}crs> POLYGON ((0 0, 6 0, 6 2, 2 2, 2 5, 0 5, 0 0))"]
    assert flat.apply(MapUpdate(places=flat.places())) is None
    assert [row["place"] for row in flat.query("robot").records()] == ["room"]


def test_sparql_asks_for_what_lies_within_a_polygon(flat):
    rows = flat.query(
        """SELECT ?place WHERE { GRAPH graph:map { ?place here:outline ?o }
           FILTER(geof:sfWithin("POINT (1 4)"^^geo:wktLiteral, ?o)) }"""
    ).rows
    assert [row[0] for row in rows] == [PLACE]


def edit(semantic_map: SemanticMap, where: str, what: str) -> None:
    semantic_map.update(
        f"WITH graph:map DELETE {{ <{PLACE}> {where} ?o }} "
        f"INSERT {{ <{PLACE}> {what} }} WHERE {{ <{PLACE}> {where} ?o }}"
    )


def test_a_new_outline_brings_its_rectangle_and_centre(flat):
    edit(flat, "here:outline", 'here:outline "POLYGON ((1 1, 9 1, 5 4, 1 1))"^^geo:wktLiteral')
    hall = flat.places()[0]
    assert (hall.xmin, hall.xmax, hall.ymin, hall.ymax) == (1, 9, 1, 4)
    assert hall.outline == (((1, 1), (9, 1), (5, 4)),)


def test_a_new_rectangle_replaces_the_outline(flat):
    edit(flat, "here:xMax", "here:xMax 7.0")
    assert outline(flat) == []
    assert flat.places()[0].area.contains(6.9, 4.9)


def test_what_is_no_polygon_is_no_outline(flat):
    for text in ("POINT (1 2)", "POLYGON ((0 0, 1 1))", "POLYGON ((a b, c d, a b))", "x" * 200_000):
        with pytest.raises(ShapeError, match="POLYGON"):
            edit(flat, "here:outline", f'here:outline "{text}"^^geo:wktLiteral')


def test_a_record_whose_outline_crosses_itself_is_refused(flat):
    ring = ((0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 3.0))
    bad = PlaceRecord(PLACE, "hall", 0, 4, 0, 4, outline=(ring,))
    with pytest.raises(InvalidFactError, match="crosses itself"):
        flat.apply(MapUpdate(places=(bad,)))
