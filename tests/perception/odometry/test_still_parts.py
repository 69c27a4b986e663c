"""What moves with the camera keeps its depth while the rest changes."""

from __future__ import annotations

import numpy as np

from perception.odometry.features import StillParts
from tests.perception.box_room import papered_frame, pose

#: in the hand: the floor's depth changes as the camera nods
MOVING = [
    papered_frame(pose(-1.5, -0.8, 0.1 * n, pitch=0.3 + 0.2 * np.sin(n)), n).depth
    for n in range(16)
]


def found(depths: list[np.ndarray]) -> np.ndarray | None:
    parts = StillParts()
    for depth in depths:
        parts.add(depth)
    return parts.found(depths[0].shape)


def with_gripper(depth: np.ndarray, off: float = 0.0) -> np.ndarray:
    changed = depth.copy()
    changed[160:, :120] = 0.4 + off
    return changed


def test_a_gripper_is_found_where_it_is():
    still = found([with_gripper(depth, 0.002 * (n % 2)) for n, depth in enumerate(MOVING)])
    assert still is not None
    assert still.dtype == np.bool_
    assert still[165:, :115].mean() > 0.95
    assert still[:140].mean() < 0.05
    assert still[165:, 150:].mean() < 0.05


def test_a_moving_camera_alone_has_no_still_parts():
    assert found(MOVING) is None


def test_a_camera_that_stays_has_none_either():
    assert found([MOVING[0]] * 16) is None


def test_a_few_images_are_not_enough():
    assert found([with_gripper(depth) for depth in MOVING[:3]]) is None


def test_a_thing_that_comes_near_later_is_not_still():
    late = [*MOVING[:8], *(with_gripper(depth) for depth in MOVING[8:])]
    assert found(late) is None
