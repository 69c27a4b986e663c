"""Rooms of drawn floors: walls cut them, tables and unseen floor do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from kg.model.records import FREE, LOW, TALL, UNKNOWN
from mapping.occupancy.mapped_floor import MappedFloor
from mapping.occupancy.room_segmentation import Segmentation, segmented
from perception.binary_masks import distance_to_walls

CELL = 0.05


def floor(width: float = 9.0, depth: float = 4.0) -> np.ndarray:
    """Free floor of one room with walls around it, and unknown cells around these."""
    states = np.full((round(width / CELL) + 20, round(depth / CELL) + 20), UNKNOWN, np.uint8)
    states[8:-8, 8:-8] = TALL
    states[10:-10, 10:-10] = FREE
    return states


def wall(states: np.ndarray, x: float, door: tuple[float, float]) -> None:
    """A wall across at `x` [m] with a door from ... to [m]."""
    column = 10 + round(x / CELL)
    opening = states[column : column + 2, 10 + round(door[0] / CELL) : 10 + round(door[1] / CELL)]
    kept = opening.copy()
    states[column : column + 2, 10:-10] = TALL
    opening[:] = kept


def rooms_of(states: np.ndarray) -> Segmentation:
    return segmented(MappedFloor(np.full(2, -10 * CELL), CELL, states))


def test_a_wall_with_a_door_makes_two_rooms_and_the_door_is_where_it_is():
    states = floor()
    wall(states, 5.0, (1.0, 1.9))
    found = rooms_of(states)
    assert len(found) == 2
    large, small = found.areas
    assert large.contains(2.0, 3.0)
    assert small.contains(8.0, 1.0)
    assert large.area == pytest.approx(5.2 * 4.5, abs=2.0)
    (door,) = found.doors
    assert door.rooms == (0, 1)
    assert door.p_map == pytest.approx((5.05, 1.45), abs=0.15)
    assert door.width == pytest.approx(0.9, abs=0.15)


def test_two_doors_in_one_wall_are_two_doors():
    states = floor()
    gap = states.copy()
    wall(states, 5.0, (0.5, 1.3))
    states[110:112, 60:76] = gap[110:112, 60:76]
    assert [door.rooms for door in rooms_of(states).doors] == [(0, 1), (0, 1)]


@pytest.mark.parametrize("kind", [LOW, UNKNOWN, TALL])
def test_what_stands_in_a_room_does_not_cut_it(kind):
    states = floor(5.0, 4.0)
    states[50:60, 40:50] = kind
    states[14:20, 10:60] = kind if kind != UNKNOWN else FREE
    assert len(rooms_of(states)) == 1


def test_unseen_floor_between_seen_floor_is_no_wall():
    states = floor(5.0, 4.0)
    states[56:64, 10:-10] = UNKNOWN
    assert len(rooms_of(states)) == 1


def test_a_corridor_is_a_room():
    states = floor(9.0, 5.2)
    states[10:-10, 34:36] = TALL  # along the whole house, 1.2 m from its wall
    for x in (30, 130):
        states[x : x + 18, 34:36] = FREE
    wall_at = 10 + round(4.5 / CELL)
    states[wall_at : wall_at + 2, 36:-10] = TALL
    found = rooms_of(states)
    assert len(found) == 3
    assert sorted(door.rooms for door in found.doors) == [(0, 2), (1, 2)]
    assert found.areas[2].contains(4.5, 0.6)


@pytest.mark.parametrize(("length", "rooms"), [(1.4, 1), (1.8, 2)])
def test_a_closet_of_less_than_one_and_a_half_square_metres_is_no_room(length, rooms):
    states = floor(6.0 + length, 4.0)
    wall(states, 6.0, (0.2, 0.9))
    states[-10 - round(length / CELL) :, 10 + round(1.0 / CELL) :] = TALL  # the closet is 1 m wide
    assert len(rooms_of(states)) == rooms


def test_a_small_part_without_neighbour_is_no_room():
    states = floor(6.0, 4.0)
    wall(states, 5.0, (0.0, 0.0))
    states[-30:, 30:] = TALL  # 1 m by 1 m is left behind the wall
    assert len(rooms_of(states)) == 1


@pytest.mark.parametrize("state", [UNKNOWN, FREE, TALL])
def test_a_floor_of_one_kind_is_one_room_or_none(state):
    found = rooms_of(np.full((64, 64), state, np.uint8))
    assert len(found) == (state == FREE)
    assert found.doors == ()


@given(npst.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_distances_are_those_to_the_nearest_wall(inside):
    walls = np.argwhere(~np.pad(inside, 1)) - 1
    found = distance_to_walls(inside, 5)
    for x, y in np.ndindex(*inside.shape):
        nearest = np.linalg.norm(walls - (x, y), axis=1).min()
        assert found[x, y] == pytest.approx(min(nearest, 5) if inside[x, y] else 0)


@given(npst.arrays(np.uint8, st.tuples(*[st.integers(4, 40)] * 2), elements=st.integers(0, 3)))
def test_any_floor_has_valid_outlines(states):
    found = rooms_of(states)
    for number, area in enumerate(found.areas):
        assert area.area > 0
        cells = found.origin + (np.argwhere(found.rooms == number) + 0.5) * found.cell
        inside = area.contains_each(cells[:, 0], cells[:, 1])
        assert inside.mean() > 0.5
