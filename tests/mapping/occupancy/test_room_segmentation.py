"""Rooms of a mapped floor."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from kg.model.records import FREE, LOW, TALL, UNKNOWN, FloorTile, MapUpdate
from kg.serving.opening import in_memory_map
from mapping.alignment.recording_fit import load_transform
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.occupancy.room_segmentation import Segmentation, segmented
from perception.binary_masks import distance_to_walls
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

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


def tile(column=0, row=0, *, free=4, storey=0, height=0.0, side=4, resolution=0.1):
    """A tile with that many free cells along its first row."""
    cells = np.full((side, side), UNKNOWN, np.uint8)
    cells[0, :free] = FREE
    return FloorTile(storey, column, row, height, resolution, cells, 1e9)


def test_tiles_lie_at_their_numbers() -> None:
    floor = mapped_floor([tile(-1, 0, free=1), tile(1, 2, free=2)])
    assert floor is not None
    assert floor.origin == pytest.approx([-0.4, 0.0])
    assert floor.states.shape == (12, 12)
    assert np.argwhere(floor.states == FREE).tolist() == [[0, 0], [8, 8], [8, 9]]
    assert floor.bounds == pytest.approx(np.array([[-0.4, 0.0], [0.5, 1.0]]))
    assert floor.span == pytest.approx(0.4)


def test_a_cropped_floor_keeps_its_cells_in_place_with_unknown_ones_around() -> None:
    floor = mapped_floor([tile(-1, 0, free=1), tile(1, 2, free=2)])
    assert floor is not None
    cropped = floor.cropped()
    assert cropped.states.shape == (11, 12)
    assert cropped.bounds == pytest.approx(floor.bounds)
    assert (cropped.states[[0, -1]] == UNKNOWN).all()
    assert (cropped.states[:, [0, -1]] == UNKNOWN).all()


def test_free_and_occupied_areas() -> None:
    states = np.array([[FREE, FREE, FREE], [LOW, TALL, UNKNOWN]], np.uint8)
    assert MappedFloor(np.zeros(2), 0.5, states).areas == pytest.approx((0.75, 0.5))


@pytest.mark.parametrize(
    ("p_map", "number"),
    [
        ((3.2, 9.6), (1, 3)),
        ((3.1999, -0.001), (0, -1)),
        ((-3.2, 0.0), (-1, 0)),
        ((67.2, 0), (21, 0)),
    ],
)
def test_a_tile_holds_its_lower_edges(p_map: tuple[float, float], number: tuple[int, int]) -> None:
    floor = MappedFloor(np.zeros(2), 0.05, np.full((1, 1), FREE, np.uint8))
    assert floor.tile_at(np.array(p_map)) == number


@pytest.mark.parametrize(
    ("height", "storey"),
    [
        (None, 0),  # the largest
        (1.2, 0),
        (4.2, 1),  # the floor just below the camera
        (2.4, 0),
        (2.9, 0),  # too far above one, and below the other
        (5.6, 0),
        (5.3, 1),
    ],
)
def test_the_storey_is_that_below_the_camera(height: float | None, storey: int) -> None:
    tiles = [tile(), tile(storey=1, height=3.0, free=2), tile(storey=2, height=1.0, free=0)]
    floor = mapped_floor(tiles, height)
    assert floor is not None
    assert floor.storey == storey


def test_a_storey_may_be_named_and_needs_free_floor() -> None:
    tiles = [tile(), tile(storey=1, height=3.0, free=2), tile(storey=2, free=0)]
    floor = mapped_floor(tiles, storey=1)
    assert floor is not None
    assert floor.storey == 1
    assert mapped_floor(tiles, storey=2) is None
    assert mapped_floor([]) is None


def test_tiles_of_another_cut_are_left_out_where_they_hold_less_free_floor() -> None:
    others = [tile(3, 0, free=1, resolution=0.2), tile(4, 0, free=1, resolution=0.2)]
    floor = mapped_floor([*others, tile(free=3)])
    assert floor is not None
    assert (floor.resolution, floor.states.shape) == (0.1, (4, 4))
    floor = mapped_floor([*others, tile(free=1)])
    assert floor is not None
    assert (floor.resolution, floor.states.shape) == (0.2, (8, 4))


def test_tiles_that_are_far_or_of_no_possible_size_are_left_out() -> None:
    near = [tile(), tile(1024, 0)]  # of four cells each, so 4096 cells away
    broken = [tile(1026, 0), tile(0, 10**9 + 1), tile(1, resolution=5e-4), tile(2, resolution=1.1)]
    floor = mapped_floor([*near[:1], *broken, tile(1, 0)])
    assert floor is not None
    assert floor.states.shape == (8, 4)
    floor = mapped_floor([tile(), tile(), *near])
    assert floor is not None
    assert floor.states.shape == (4 * 1025, 4)


def floor_of(shared, sequence: str, every: int) -> tuple[MappedFloor, np.ndarray]:
    """The floor of every so manieth frame, and the recording's T_map_world."""
    T = load_transform(shared("data/rgbd/composite_building.json"), sequence)
    options = RecordingOptions(T_map_world=T, check=False)
    recording = open_recording(shared(f"data/rgbd/{sequence}"), options)
    with in_memory_map() as semantic_map:
        book = OccupancyMap(semantic_map)
        for index in range(0, len(recording), every):
            book.add(next(iter(recording.frames(index))))
        semantic_map.apply(MapUpdate(floor=book.take_rest()))
        floor = mapped_floor(semantic_map.floor())
    assert floor is not None
    return floor, T


def spots(floor: MappedFloor, *states: int) -> np.ndarray:
    """(n, 2) [m] the cells with one of these states."""
    at = np.argwhere(np.isin(floor.states, states))
    return floor.origin + (at + 0.5) * floor.resolution


def away(points: np.ndarray, p_map: np.ndarray) -> float:
    """[m] from `p_map` to the nearest of the points."""
    return float(np.linalg.norm(points - p_map[:2], axis=1).min())


def test_the_real_kitchen_has_its_walls_table_and_chairs(shared):
    floor, T = floor_of(shared, "redkitchen", 5)
    truth = json.loads(shared("data/rgbd/redkitchen/objects_gt.json").read_text())["objects"]
    wall, furniture = spots(floor, TALL), spots(floor, LOW)
    for name, known in truth.items():
        p_map = T @ np.append(known["position"], 1)
        if known["cls"] in ("chair", "dining table", "cup"):
            assert away(furniture, p_map) < 0.1, name
        if known["cls"] == "tv":  # they hang on the walls
            assert away(wall, p_map) < 0.25, name
    along = [x for x in np.arange(-3.0, 2.0, 0.05) if (abs(wall[:, 0] - x) < 0.03).any()]
    back = np.array([wall[abs(wall[:, 0] - x) < 0.03, 1].min() for x in along])
    assert len(along) > 80  # nearly all of its five metres
    assert (abs(back - np.median(back)) < 0.11).mean() > 0.95  # as straight as two cells
    assert spots(floor, FREE)[:, 1].min() > np.median(back)
    assert len(spots(floor, FREE)) * floor.resolution**2 > 1.5  # [m^2]
