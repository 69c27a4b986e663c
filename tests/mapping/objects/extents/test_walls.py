"""Boxes beside walls: parallel to them, unless the surface is clear, and not through them."""

import math

import numpy as np
import pytest

from kg.model.areas import OrientedBox
from mapping.objects.extents.box_fit import BoxViews
from mapping.objects.extents.surface_growth import Walls, grown_box
from tests.mapping.objects.extents.test_grown_boxes import VOXEL, Surface, around, shell, view

STEPS = np.arange(-2, 2, 0.0125)
HEIGHTS = np.arange(0, 2, 0.0125)
TURN = 0.4  # [rad] of the walls


def turned(points: np.ndarray, yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return points @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)])


def wall(y: float) -> np.ndarray:
    """(n, 3) [m] points of a wall 4 m long at `y` [m], in the frame of the walls."""
    x, z = (axis.ravel() for axis in np.meshgrid(STEPS, HEIGHTS, indexing="ij"))
    return np.stack([x, np.full(len(x), y), z], 1)


def walls(*offsets: float, top: float = 2.0) -> Walls | None:
    points = np.concatenate([turned(wall(y), TURN) for y in offsets])
    points = points[points[:, 2] < top]
    return Walls.of(*Surface(points)(np.full(3, -9.0), np.full(3, 9.0)))


def test_the_direction_of_walls_is_found() -> None:
    found = walls(1.0, -1.5)
    assert found is not None
    assert found.yaw == pytest.approx(TURN, abs=math.radians(1.5))


def test_a_floor_has_no_walls() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(STEPS, STEPS, indexing="ij"))
    floor = Surface(np.stack([x, y, np.zeros(len(x))], 1))
    assert Walls.of(*floor(np.full(3, -9.0), np.full(3, 9.0))) is None
    assert Walls.of(np.empty((0, 3)), VOXEL) is None


@pytest.mark.parametrize(("yaw", "parallel"), [(0.0, True), (0.1, True), (0.6, False)])
def test_a_box_is_parallel_to_walls_unless_it_is_clearly_turned(yaw, parallel) -> None:
    true = OrientedBox(np.array([0.0, 0.0, 0.25]), np.array([1.0, 0.5, 0.5]), yaw)
    points = shell(true)
    views = BoxViews.of([view(T, points) for T in around(true)])
    box = grown_box(Surface(points), true.centre - 1, true.centre + 1, views, 0.0)
    assert box is not None
    assert (box.yaw == 0.0) == parallel


def test_a_box_ends_at_the_wall_behind_it() -> None:
    found = walls(0.4)
    assert found is not None
    shown = OrientedBox(np.array([0.0, 0.0, 0.5]), np.array([0.6, 0.5, 1.0]), found.yaw)
    fitted = OrientedBox(np.array([0.0, 0.0, 0.5]), np.array([0.6, 1.4, 1.0]), found.yaw)
    cut = found.kept_before(fitted, shown)
    np.testing.assert_allclose(cut.extent, [0.6, 1.1, 1.0], atol=2 * VOXEL)
    np.testing.assert_allclose(
        cut.centre, turned(np.array([[0.0, -0.15, 0.5]]), TURN)[0], atol=2 * VOXEL
    )
    same = found.kept_before(shown, shown)
    np.testing.assert_allclose(same.extent, shown.extent)


def test_a_wall_does_not_cut_what_the_surface_shows_of_a_thing() -> None:
    found = walls(0.2)
    assert found is not None
    box = OrientedBox(np.array([0.0, 0.0, 0.5]), np.array([0.6, 0.8, 1.0]), found.yaw)
    np.testing.assert_allclose(found.kept_before(box, box).extent, box.extent)


@pytest.mark.parametrize(("bottom", "cut"), [(0.0, True), (0.9, False)])
def test_only_what_stands_as_high_as_a_box_cuts_it(bottom: float, cut: bool) -> None:
    found = walls(0.4, top=0.8)  # as a low cupboard
    assert found is not None
    centre = np.array([0.0, 0.0, bottom + 0.25])
    shown = OrientedBox(centre, np.array([0.6, 0.5, 0.5]), found.yaw)
    fitted = OrientedBox(centre, np.array([0.6, 1.4, 0.5]), found.yaw)
    assert (found.kept_before(fitted, shown).extent[1] < 1.2) == cut
