"""Mapped floor: tiles of one storey become one grid."""

from __future__ import annotations

import numpy as np
import pytest

from kg.model.records import FREE, LOW, TALL, UNKNOWN, FloorTile
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor


def tile(
    column: int = 0,
    row: int = 0,
    *,
    free: int = 4,
    storey: int = 0,
    height: float = 0.0,
    side: int = 4,
    resolution: float = 0.1,
) -> FloorTile:
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
