"""Boxes turned about the vertical: corners, bounds, and the same box by other sides."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from kg.model.areas import along_nearest_axes, footprint, upright_bounds

sides = st.floats(0.02, 5)
yaws = st.floats(-2 * math.pi, 2 * math.pi)


def test_a_turned_footprint_has_its_corners_where_they_belong() -> None:
    corners = footprint(np.array([1.0, 2.0, 0.5]), np.array([2.0, 1.0, 1.0]), math.pi / 2)
    np.testing.assert_allclose(corners, [(1.5, 1), (1.5, 3), (0.5, 3), (0.5, 1)], atol=1e-12)


@given(sides, sides, yaws)
def test_the_bounds_hold_the_footprint_and_nothing_more(x: float, y: float, yaw: float) -> None:
    extent = np.array([x, y, 1.0])
    spread = np.ptp(footprint(np.zeros(3), extent, yaw), axis=0)
    np.testing.assert_allclose(upright_bounds(extent, yaw), [*spread, 1.0], atol=1e-9)


@given(sides, sides, yaws)
def test_the_nearest_axes_give_the_same_footprint(x: float, y: float, yaw: float) -> None:
    *other, turn = along_nearest_axes(x, y, yaw)
    assert abs(turn) <= math.pi / 4 + 1e-9
    one, two = (
        shapely.Polygon(footprint(np.zeros(2), np.array(extent), angle))
        for extent, angle in (((x, y), yaw), (other, turn))
    )
    assert one.intersection(two).area == pytest.approx(one.area, rel=1e-6)
