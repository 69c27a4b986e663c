"""Inverse sensor model: points of one frame become free, occupied and viewed cells."""

import numpy as np
import pytest

from mapping.occupancy.depth_projection import (
    FloorEvidence,
    FramePoints,
    floor_evidence,
    frame_points,
)
from mapping.occupancy.occupancy_settings import OccupancySettings

SETTINGS = OccupancySettings()
CAMERA = np.array([0.0, 0.0, 1.2])
NOWHERE = (np.nan, np.nan, np.nan)


def evidence(*column: tuple[float, ...], depth: float | tuple[float, ...] = 1.0) -> FloorEvidence:
    """Evidence of the points (x, y, z) [m] of one image column, from its top on."""
    xyz = np.array(column, float).T[:, :, None]
    depths = np.where(np.isnan(xyz[2]), np.nan, np.reshape(depth, (-1, 1)))
    return floor_evidence(FramePoints(xyz, depths), CAMERA, 0.0, SETTINGS)


def cells(found: FloorEvidence, which: str) -> list[tuple[int, int]]:
    """Cells of that kind, by their number from the origin of the map."""
    first = np.array(found.tile) * SETTINGS.side
    return [(int(x), int(y)) for x, y in np.argwhere(getattr(found, which)) + first]


def test_one_point_on_the_floor_makes_its_cell_free() -> None:
    found = evidence((1.02, -0.51, 0.01))
    assert cells(found, "free") == [(20, -11)]
    assert cells(found, "hit") == []


def test_an_obstacle_takes_two_points_and_is_not_free() -> None:
    post = [(1.02, 0.02, 0.3), NOWHERE, (1.03, 0.02, 0.5)]
    assert cells(evidence(post[0]), "hit") == []
    assert cells(evidence(*post), "hit") == [(20, 0)]
    both = evidence(*post, NOWHERE, (1.01, 0.01, 0.0))
    assert (cells(both, "hit"), cells(both, "free")) == ([(20, 0)], [])


@pytest.mark.parametrize(
    ("z", "kind"),
    [
        (0.05, "free"),  # level and its growth: 0.055 m at 1 m of depth
        (-0.05, "free"),
        (0.07, ""),  # neither: within the clearance
        (-0.07, ""),
        (0.1, "hit"),
        (1.09, "hit"),
        (1.11, "tall"),
        (1.79, "tall"),
        (1.81, ""),  # above everybody's head
    ],
)
def test_the_height_of_points_tells_floor_and_obstacles_apart(z: float, kind: str) -> None:
    found = evidence((1.02, 0.02, z), NOWHERE, (1.02, 0.02, z))
    told = {which for which in ("free", "hit", "tall") if cells(found, which)}
    assert told == {"": set(), "tall": {"hit", "tall"}}.get(kind, {kind})


def test_one_point_above_the_eyes_does_not_make_an_obstacle_tall() -> None:
    found = evidence((1.02, 0.02, 1.2), NOWHERE, (1.02, 0.02, 0.5), NOWHERE, (1.02, 0.02, 0.3))
    assert (cells(found, "hit"), cells(found, "tall")) == ([(20, 0)], [])


def test_floor_between_two_points_of_a_column_is_free_and_between_two_things_is_not() -> None:
    found = evidence((1.22, 0.02, 0.0), (1.02, 0.02, 0.0))
    assert cells(found, "free") == [(x, 0) for x in (20, 21, 22, 23, 24)]
    near = evidence((1.23, 0.02, 0.5), (1.03, 0.02, 0.5), depth=(1.2, 1.0))
    assert cells(near, "hit") == []  # one point and none that repeat it in a cell
    wide = evidence((1.07, 0.02, 0.5), (1.02, 0.02, 0.5), depth=(1.1, 1.0))
    assert cells(wide, "hit") == [(20, 0), (21, 0)]
    apart = evidence((1.07, 0.02, 0.5), (1.02, 0.02, 0.5), depth=(1.3, 1.0))
    assert cells(apart, "hit") == []  # two things, one behind the other


def test_points_beyond_the_grid_of_a_wide_camera_are_left_out() -> None:
    span, reach = SETTINGS.span, SETTINGS.far
    far = [(x, y, 0.0) for x, y in ((0.0, 30.0), (30.0, 0.0), (-30.0, 1.0), (1.0, -30.0))]
    column = [point for each in far for point in (each, NOWHERE)]
    assert cells(evidence(*column), "free") == []
    found = evidence((1.02, 0.02, 0.0))
    assert found.tile == (int(np.floor(-reach / span)),) * 2
    assert len(found.free) * SETTINGS.cell >= 2 * reach


def test_level_surfaces_count_as_viewed_and_walls_do_not() -> None:
    size = SETTINGS.cell * SETTINGS.view

    def viewed(found: FloorEvidence) -> list[list[int]]:
        first = [0, *(np.array(found.tile) * SETTINGS.side // SETTINGS.view)]
        return (np.argwhere(found.viewed) + first).tolist()

    middle = (5.5 * size, 2.5 * size)
    table = [(1.5, middle[1], 0.7), (*middle, 0.7)]
    assert viewed(evidence(*table)) == [[0, 5, 2], [1, 5, 2]]
    assert viewed(evidence(*table, depth=2.1)) == [[1, 5, 2]]  # not from close by
    assert viewed(evidence((middle[0], middle[1], 0.9), (*middle, 0.7))) == []
    edge = (5.9 * size, 2.5 * size)
    assert viewed(evidence((1.5, edge[1], 0.7), (*edge, 0.7))) == []
    assert viewed(evidence((1.5, middle[1], 1.9), (*middle, 1.9))) == []


def test_depth_out_of_range_or_on_an_edge_is_left_out() -> None:
    K = np.array([[96.0, 0.0, 47.5], [0.0, 96.0, 47.5], [0.0, 0.0, 1.0]])
    depth = np.full((96, 96), 2.0, np.float32)
    depth[:, :10], depth[:, 10:20], depth[:, 60:] = 0.39, 4.01, 2.2
    points = frame_points(depth, K, np.eye(4), SETTINGS)
    known = np.isfinite(points.depth)
    assert points.depth.shape == (95, 95)
    assert not known[:, :20].any()
    assert known[:, 20:59].all()
    assert not known[:, 59].any()  # its neighbour is farther by a tenth
    assert known[:, 60:].all()
    u, v = 30, 70
    expected = 2.0 * np.array([(u - 47.5) / 96, (v - 47.5) / 96, 1.0])
    assert points.xyz[:, v, u] == pytest.approx(expected)
