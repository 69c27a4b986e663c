"""Depth that a driver repeats while colour goes on is no depth."""

from __future__ import annotations

import numpy as np

from perception.frames import Frame
from perception.odometry.frozen_depth import FrozenDepth

RANDOM = np.random.default_rng(0)


def frame(bright: float, depth: np.ndarray) -> Frame:
    rgb = np.clip(bright + RANDOM.normal(0, 5, (240, 320, 3)), 0, 255).astype(np.uint8)
    return Frame("1", rgb, depth, np.eye(3), np.eye(4), 0.0)


def known(frames: list[Frame]) -> tuple[list[bool], int]:
    frozen = FrozenDepth()
    return [bool(np.isfinite(f.depth).any()) for f in frozen.without(frames)], frozen.count


def depth() -> np.ndarray:
    return RANDOM.uniform(1, 3, (240, 320)).astype(np.float32)


def test_frozen_depth_is_taken_away_until_it_changes() -> None:
    frozen = depth()
    frozen[0, :9] = np.nan
    frames = [frame(20.0 * n, frozen if n in (1, 2, 3) else depth()) for n in range(6)]
    assert known(frames) == ([True, True, False, False, True, True], 2)


def test_a_camera_that_stands_still_keeps_its_depth() -> None:
    same = depth()
    assert known([frame(100, same) for _ in range(5)]) == ([True] * 5, 0)
