"""Ray test: what a depth image shows of a volume 2 m ahead, in the frame of `make_frame`."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.objects.existence import VolumeView, in_front, ray_test
from mapping.objects.settings import ObjectSettings

SETTINGS = ObjectSettings()
AHEAD = np.array([2.0, 0.0, 1.0])  # on the optical axis
SIZE = 0.3


def seen(frame, p_map=AHEAD, size=SIZE):
    return ray_test(frame, np.asarray(p_map, dtype=np.float64), size, SETTINGS)


@pytest.mark.parametrize(
    ("depth", "expected"),
    [
        (2.0, VolumeView.SURFACE),
        (2.2, VolumeView.SURFACE),  # its far side
        (4.0, VolumeView.EMPTY),
        (1.0, VolumeView.NOTHING),  # hidden
        (np.nan, VolumeView.NOTHING),  # no return
        (0.0, VolumeView.NOTHING),
    ],
)
def test_rays_end_inside_go_through_or_tell_nothing(make_frame, depth, expected):
    assert seen(make_frame(depth)) is expected


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("axis", "far"), [(1, 1.25), (2, 0.9)])
def test_a_volume_that_the_border_cuts_is_not_judged(make_frame, axis, far, side):
    """32 columns and 24 rows of 50 px focal length: 1.28 m and 0.96 m at 2 m."""
    cut, whole = AHEAD.copy(), AHEAD.copy()
    cut[axis] += side * far
    whole[axis] += side * far / 2
    assert seen(make_frame(4.0), cut) is VolumeView.NOTHING
    assert seen(make_frame(4.0), whole) is VolumeView.EMPTY


def test_a_volume_that_is_partly_hidden_is_not_judged(make_frame):
    depth = np.full((49, 65), 4.0)
    depth[:, :33] = 1.0  # something stands before its left half
    assert seen(make_frame(depth)) is VolumeView.NOTHING


def test_a_thing_that_covers_half_the_volume_leaves_a_surface(make_frame):
    depth = np.full((49, 65), 4.0)
    depth[:, :33] = 2.0
    assert seen(make_frame(depth)) is VolumeView.SURFACE


def test_what_is_in_front_is_in_the_image_and_in_range(make_frame):
    s = SETTINGS
    positions = {
        "ahead": (2.0, 0.0, 1.0),
        "near the border": (2.0, 1.2, 1.0),
        "left of the image": (2.0, 1.4, 1.0),
        "below the image": (2.0, 0.0, -0.1),
        "behind": (-2.0, 0.0, 1.0),
        "in the camera": (0.0, 0.0, 1.0),
        "too near": (s.nearest_sight - 0.1, 0.0, 1.0),
        "too far": (s.farthest_sight + 0.1, 0.0, 1.0),
    }
    found = in_front(make_frame(2.0), np.array([*positions.values()]), s)
    assert [list(positions)[index] for index in found] == ["ahead", "near the border"]
    assert len(in_front(make_frame(2.0), np.zeros((0, 3)), s)) == 0
