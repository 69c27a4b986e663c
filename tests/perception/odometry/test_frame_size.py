"""Images larger than those that are tracked show the same scene when they are shrunk."""

from __future__ import annotations

import numpy as np
import pytest

from perception.frames import Frame
from perception.odometry.features import MAX_SIDE, shrunk
from tests.perception.conftest import look_at, room_depth

T = look_at((0, 0, 1.4), (2, 0.5, 0.7))


def frame(width: int, height: int) -> Frame:
    K = np.array([[0.8 * width, 0, 0.51 * width], [0, 0.8 * width, 0.48 * height], [0, 0, 1.0]])
    depth = room_depth(T, K, (width, height)).astype(np.float32)
    rgb = np.repeat((depth * 50).astype(np.uint8)[..., None], 3, axis=2)
    return Frame("1", rgb, depth, K, T, 0.0)


@pytest.mark.parametrize("size", [(4001, 3001), (1921, 1080), (1080, 1921)])
def test_shrunk_depth_is_that_of_the_shrunk_camera(size: tuple[int, int]) -> None:
    small = shrunk(frame(*size))
    assert max(small.depth.shape) <= MAX_SIDE < max(size)
    assert small.rgb.shape[:2] == small.depth.shape
    expected = room_depth(T, small.K, small.depth.shape[::-1])
    assert np.median(np.abs(small.depth - expected)) < 0.002
    assert np.abs(small.rgb[..., 0] - small.depth * 50).mean() < 2


def test_images_of_usual_size_stay() -> None:
    usual = frame(MAX_SIDE, 720)
    assert shrunk(usual) is usual
