from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.frames.projection import project, to_map
from mapping.reference.object_update import in_field_of_view, missed, occluded, window
from mapping.reference.settings import ReferenceSettings

K = np.array([[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]])


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.1, 10))
def test_in_view_means_on_a_pixel(x, y, z):
    p_cam = np.array([x, y, z])
    row, column = project(p_cam, K)
    u, v = 50 * x / z + 32, 50 * y / z + 24
    if min(abs(u + 0.5), abs(u - 64.5), abs(v + 0.5), abs(v - 48.5)) > 1e-6:
        on_a_pixel = 0 <= row < 49 and 0 <= column < 65
        assert in_field_of_view(p_cam, K, (49, 65)) == on_a_pixel


def test_behind_the_camera_is_out_of_view():
    assert not in_field_of_view(np.array([0.0, 0.0, -1.0]), K, (49, 65))
    assert not in_field_of_view(np.array([0.0, 0.0, 0.0]), K, (49, 65))


def test_window_is_ten_by_ten_and_clipped():
    depth = np.ones((49, 65), dtype=np.float32)
    assert len(window(depth, 24, 32, 10)) == 100
    assert len(window(depth, 0, 0, 10)) == 25
    depth[24, 32] = np.nan
    assert len(window(depth, 24, 32, 10)) == 99


def test_one_nearer_pixel_occludes():
    depths = np.array([2.5, 2.5, 1.9], dtype=np.float32)
    assert occluded(depths, 2.0, 0.0)
    assert not occluded(depths, 1.9, 0.0)
    assert not occluded(depths, 2.0, 0.15)


CENTRE_2M = np.array([2.0, 0.0, 1.0])  # straight ahead of the fixture's camera


def test_free_line_of_sight_to_empty_space_is_a_miss(make_frame):
    assert missed(make_frame(3.0), CENTRE_2M, ReferenceSettings())


def test_something_in_front_is_an_excuse(make_frame):
    assert not missed(make_frame(1.5), CENTRE_2M, ReferenceSettings())


def test_no_depth_is_an_excuse(make_frame):
    assert not missed(make_frame(np.nan), CENTRE_2M, ReferenceSettings())


def test_out_of_view_is_an_excuse(make_frame):
    assert not missed(make_frame(3.0), np.array([2.0, 5.0, 1.0]), ReferenceSettings())


@pytest.mark.parametrize(
    ("x", "expected"), [(0.7, False), (0.9, True), (4.5, True), (4.7, False), (-2.0, False)]
)
def test_only_the_sensors_good_range_counts(make_frame, x, expected):
    assert missed(make_frame(8.0), np.array([x, 0.0, 1.0]), ReferenceSettings()) is expected


def test_own_front_occludes_under_the_strict_rule_and_not_with_a_tolerance(make_frame):
    # an object whose mean lies 5 cm behind its front
    behind_front = np.array([2.05, 0.0, 1.0])
    frame = make_frame(2.0)
    assert not missed(frame, behind_front, ReferenceSettings())
    assert missed(frame, behind_front, ReferenceSettings(occlusion_tolerance=0.075))


def test_visibility_does_not_depend_on_where_the_map_lies(make_frame):
    T = np.eye(4)
    T[:3, 3] = [10.0, -4.0, 2.0]
    here, there = make_frame(3.0), make_frame(3.0, T=T @ make_frame().T_map_cam)
    for x in (0.5, 2.0, 3.5, 5.0):
        p = np.array([x, 0.2, 1.1])
        s = ReferenceSettings()
        assert missed(here, p, s) == missed(there, to_map(T, p), s)
