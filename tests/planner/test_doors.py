"""Doors are found where they were cut, and shut or avoided."""

from __future__ import annotations

import numpy as np
import pytest

from kg.errors import LayoutError
from planner.space.building import free_space
from planner.space.doors import DETOUR, door_toll, doors, shut
from planner.space.geodesic import distance_fields, metres_between
from planner.space.grid import FreeSpace, Room
from planner.space.sight import visible

LEFT, RIGHT, BACK = Room(0, 4, 0, 4), Room(4, 8, 0, 4), Room(0, 8, 4, 7)


def two() -> tuple[FreeSpace, int, int]:
    space = free_space([LEFT, RIGHT])
    return space, space.nearest((1, 2)), space.nearest((7, 2))


def test_every_door_of_a_plan_is_found_where_it_was_cut() -> None:
    found = doors(free_space([LEFT, RIGHT, BACK]))
    assert [door.rooms for door in found] == [(0, 1), (0, 2), (1, 2)]
    np.testing.assert_allclose(found[0].p_map, (4, 2), atol=0.25)
    np.testing.assert_allclose(found[1].p_map, (2, 4), atol=0.25)
    assert all(4 <= len(door.cells) <= 6 for door in found)  # 0.9 m in cells of 0.2 m
    assert doors(free_space([LEFT, RIGHT], [])) == doors(free_space([LEFT]))


def test_two_doors_between_the_same_rooms_are_two() -> None:
    around = [Room(0, 9, 0, 3), Room(0, 9, 3, 6)]
    space = free_space(around)
    (door,) = doors(space)
    room = space.room.copy()
    row = np.flatnonzero(room[6] == -1)[1]  # the wall between the two
    room[3:6, row] = 1
    more = doors(FreeSpace(space.origin, space.cell, room))
    assert [d.rooms for d in more] == [(0, 1), (0, 1)]
    np.testing.assert_allclose(more[1].p_map, door.p_map)


@pytest.mark.parametrize("number", range(3))
def test_a_shut_door_stops_robot_and_eye_and_the_others_stay_open(number: int) -> None:
    space = free_space([LEFT, RIGHT, BACK])
    found = doors(space)
    door = found[number]
    ahead = shut(space, [door])
    a, b = (space.nearest(door.p_map, room) for room in door.rooms)
    a, b = (ahead.nearest(door.p_map, room) for room in door.rooms)
    assert metres_between(space, [a, b])[0, 1] < 1.5
    assert 2.0 < metres_between(ahead, [a, b])[0, 1] < 20.0
    assert b not in visible(ahead, a, 4.6)[0]
    assert [d.rooms for d in doors(ahead)] == [d.rooms for d in found if d is not door]
    closed = shut(space, found)
    assert np.isinf(metres_between(closed, [a, b])[0, 1])
    beyond = visible(closed, a, 12.0)[0]
    assert set(closed.room.reshape(-1)[beyond].tolist()) == {door.rooms[0]}


def test_a_door_that_is_likelier_shut_costs_more_and_sight_keeps() -> None:
    space, a, b = two()
    (door,) = doors(space)
    plain = float(distance_fields(space, [a])[0].flat[b])
    for probability in (0.0, 0.2, 0.6, 1.0):
        toll = door_toll(space, {door: probability})
        paid = float(distance_fields(space, [a], toll)[0].flat[b]) - plain
        assert paid == pytest.approx(probability * DETOUR, abs=0.05)


def test_a_doubtful_door_is_gone_around_where_the_way_around_is_short() -> None:
    space = free_space([LEFT, RIGHT, BACK])
    a, b = space.nearest((3, 3)), space.nearest((5, 3))
    toll = door_toll(space, {doors(space)[0]: 0.9}, detour=30.0)
    paid = float(distance_fields(space, [a], toll)[0].flat[b])
    assert float(distance_fields(space, [a])[0].flat[b]) < paid < 27.0


def test_no_doors_shut_change_nothing_and_odd_probabilities_are_refused() -> None:
    space, _, _ = two()
    assert shut(space, []) is space
    with pytest.raises(LayoutError, match=r"must lie in 0\.\.1, got 1\.5"):
        door_toll(space, {doors(space)[0]: 1.5})
