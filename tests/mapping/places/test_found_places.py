"""Rooms of the floor become places, which stay who they are as the floor grows."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hereabouts.cli import main
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import area_of
from kg.model.records import FREE, TALL, UNKNOWN, FloorTile, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.room_edit import RoomEdit
from kg.serving.opening import create_map, in_memory_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.places.found_places import find_places

SIDE, CELL = 256, 0.05  # one tile of 12.8 m
KITCHEN, OFFICE = "kitchen", "office"


@pytest.fixture
def home():
    with in_memory_map(base="http://m/") as made:
        yield made


def floor(*walls: float, until: float = 12.0) -> MapUpdate:
    """A house 4 m deep from x = 0.5 m `until`, with walls across at `walls`; doors in each."""
    cells = np.full((SIDE, SIDE), UNKNOWN, np.uint8)
    right = round(until / CELL)
    cells[8:right, 8:92] = TALL
    cells[10 : right - 2, 10:90] = FREE
    for x in walls:
        at = round(x / CELL)
        cells[at : at + 2, 10:90] = TALL
        cells[at : at + 2, 30:48] = FREE
    return MapUpdate(floor=(FloorTile(0, 0, 0, 0.0, CELL, cells, 1.0),))


def labels(semantic_map: SemanticMap) -> dict[str, str]:
    return {place.iri.rpartition("/")[2]: place.label for place in semantic_map.places()}


def place_at(semantic_map: SemanticMap, x: float) -> PlaceRecord:
    (found,) = [place for place in semantic_map.places() if place.area.contains(x, 2.0)]
    return found


def viewed(semantic_map: SemanticMap, x: float, category: str, views: int) -> None:
    kind = semantic_map.catalogue.find(category, "place").iri
    place = replace(place_at(semantic_map, x), views=views, beliefs={kind: 1.0})
    semantic_map.apply(MapUpdate(places=(place,)))


def test_rooms_become_places_with_doors_between_them(home):
    home.apply(floor(6.0))
    chair = home.catalogue.find("chair", "object").iri
    thing = ObjectRecord(home.new_object_iri(), chair, np.array([8.0, 2, 0]), 1, 1, 1, 0, 0)
    home.apply(MapUpdate(objects=(thing,)))
    west, east = find_places(home)
    assert (west.from_floor, west.adjacent, east.adjacent) == (True, (east.iri,), (west.iri,))
    assert home.objects()[0].place == place_at(home, 8.0).iri
    (door,) = home.doors()
    assert set(door.places) == {west.iri, east.iri}
    assert (door.x, door.y) == pytest.approx((6.05, 1.95), abs=0.15)


def test_finding_again_changes_nothing(home):
    home.apply(floor(6.0))
    find_places(home)
    before = home.sequence
    find_places(home)
    assert home.sequence == before


def test_a_place_that_grows_stays_itself(home):
    home.apply(floor(5.0, until=7.0))
    find_places(home)
    viewed(home, 2.0, KITCHEN, 3)
    viewed(home, 6.0, OFFICE, 2)
    before = {x: place_at(home, x).iri for x in (2.0, 6.0)}
    home.assertions.add(before[6.0], "label", "Ann's room", by="ann")
    home.apply(floor(5.0, 10.0, until=12.5))  # the second room is seen to be far larger
    find_places(home)
    assert {x: place_at(home, x).iri for x in (2.0, 6.0)} == before
    assert place_at(home, 6.0).label == "Ann's room"
    assert place_at(home, 8.5).iri == before[6.0]
    assert (place_at(home, 2.0).views, place_at(home, 6.0).views) == (3, 2)
    assert place_at(home, 11.0).iri not in before.values()


def test_places_that_become_one_join_their_views(home):
    home.apply(floor(6.0))
    find_places(home)
    viewed(home, 2.0, KITCHEN, 3)
    viewed(home, 9.0, OFFICE, 1)
    home.apply(floor())
    (left,) = find_places(home)
    (stored,) = home.places()
    assert stored.views == 4
    assert sorted(stored.beliefs.values()) == [0.25, 0.75]
    assert home.doors() == ()
    assert left.adjacent == ()
    rows = home.query(
        "SELECT ?s WHERE { GRAPH graph:map { ?s ?p ?o } FILTER(CONTAINS(STR(?s), 'place/2')) }"
    ).rows
    assert not rows  # nothing is left of the other


def test_two_places_that_people_named_stay_two(home):
    home.apply(floor(6.0))
    find_places(home)
    for x, name in ((2.0, "north wing"), (9.0, "south wing")):
        home.assertions.add(place_at(home, x).iri, "label", name, by="ann")
    home.apply(floor())
    find_places(home)
    assert set(labels(home).values()) == {"north wing", "south wing"}
    assert place_at(home, 2.0).label == "north wing"
    assert place_at(home, 9.0).label == "south wing"


def test_an_outline_that_hardly_changes_is_not_written_again(home):
    home.apply(floor(6.0))
    find_places(home)
    before = place_at(home, 9.0)
    home.apply(floor(6.0, until=12.05))
    find_places(home)
    assert place_at(home, 9.0).area == before.area
    home.apply(floor(6.0, until=12.5))
    find_places(home)
    assert place_at(home, 9.0).area != before.area


def test_given_places_stay_as_they_are(home):
    given = PlaceRecord("http://m/place/7", "hall", 0, 1, 0, 1).with_area(
        area_of([[(0, 0), (6, 0), (6, 5), (0, 5)]])
    )
    home.apply(MapUpdate(places=(given,)))
    home.apply(floor(6.0))
    find_places(home)
    hall, other = home.places()
    assert (hall.area, hall.from_floor) == (given.area, False)
    assert other.iri == "http://m/place/8"
    assert other.area.contains(9, 2)


def test_what_people_draw_the_floor_leaves(home):
    home.apply(floor(6.0))
    find_places(home)
    place = place_at(home, 9.0)
    ring = "6 0, 13 0, 13 5, 6 5.5, 6 0"
    home.update(
        f"WITH graph:map DELETE {{ <{place.iri}> here:outline ?o }} INSERT {{ <{place.iri}> "
        f'here:outline "POLYGON (({ring}))"^^geo:wktLiteral }} '
        f"WHERE {{ <{place.iri}> a here:Place OPTIONAL {{ <{place.iri}> here:outline ?o }} }}"
    )
    home.apply(floor(6.0, until=12.5))
    find_places(home)
    drawn = place_at(home, 9.0)
    assert (drawn.iri, drawn.from_floor, drawn.area.ymax) == (place.iri, False, 5.5)


def test_a_mapper_finds_places_while_it_maps(home, step_back, make_detections):
    home.apply(floor(6.0))
    with Mapper(home, MappingOptions(find_places=True), recording="walk") as mapper:
        mapper.add(step_back(0), make_detections())
        mapper.add(step_back(1), make_detections())
        first = {place.iri for place in home.places()}
        assert len(home.doors()) == 1
        home.apply(floor(4.0, 8.0))
        mapper.add(step_back(2, stamp=1e9 + 60), make_detections())
    assert first < {place.iri for place in home.places() if place.from_floor}
    assert len(home.doors()) == 2
    assert all(place.from_floor for place in home.places())


def test_the_command_lists_what_it_found(tmp_path, capsys):
    with create_map(tmp_path / "flat.map") as made:
        made.apply(floor(6.0))
    assert main(["rooms", str(tmp_path / "flat.map"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert main(["rooms", str(tmp_path / "flat.map"), "find", "--json"]) == 0
    one, two = json.loads(capsys.readouterr().out)
    assert (one["label"], one["adjacent"], two["adjacent"]) == ("room 1", "room 2", "room 1")


def test_without_floor_nothing_changes(home):
    assert find_places(home) == ()


def test_edited_rooms_outrank_the_rooms_found_later(tmp_path):
    with create_map(tmp_path / "home.map") as home:
        home.apply(floor(6.0))
        find_places(home)
        left = place_at(home, 3.0).iri.removeprefix(home.base)
        home.rooms.edit(RoomEdit("split", (left,), ((2.0, 0.0), (2.0, 4.0)), "pantry"), by="ann")
        drawn = {iri: place_at(home, x).area for iri, x in (("pantry", 1.0), ("rest", 3.0))}
        home.apply(floor(6.0, until=11.0))
        find_places(home)
        assert place_at(home, 1.0).label == "pantry"
        assert {iri: place_at(home, x).area for iri, x in (("pantry", 1.0), ("rest", 3.0))} == drawn
        assert place_at(home, 9.0).area.xmax < 11.5
        (door,) = home.doors()
        assert {place_at(home, 3.0).iri, place_at(home, 9.0).iri} == set(door.places)


def test_a_marked_door_stays_when_doors_are_found_anew(tmp_path):
    with create_map(tmp_path / "home.map") as home:
        home.apply(floor(6.0))
        find_places(home)
        one, other = (place_at(home, x).iri.removeprefix(home.base) for x in (3.0, 9.0))
        home.rooms.edit(RoomEdit("door", (one, other), ((6.05, 4.0),)), by="ann")
        assert len(home.doors()) == 2
        find_places(home)
        assert [bool(door.marked_by) for door in home.doors()] == [False, True]
