"""Colour and depth of two moments make no frame."""

from __future__ import annotations

import numpy as np

from perception.frames import Frame
from perception.odometry.features import FrozenImages

RANDOM = np.random.default_rng(0)


def colour(bright: float) -> np.ndarray:
    return np.clip(bright + RANDOM.normal(0, 5, (240, 320, 3)), 0, 255).astype(np.uint8)


def depth(metres: float) -> np.ndarray:
    """Depth with the noise of a sensor, and a part without return."""
    made = (metres * RANDOM.normal(1, 0.01, (240, 320))).astype(np.float32)
    made[:, :9] = np.nan
    return made


def known(rgb: list[np.ndarray], z: list[np.ndarray]) -> tuple[list[bool], int]:
    frozen = FrozenImages()
    frames = (Frame("1", a, b, np.eye(3), np.eye(4), 0.0) for a, b in zip(rgb, z, strict=True))
    return [not frozen.add(frame) for frame in frames], frozen.count


def test_frozen_depth_is_noticed_until_it_changes() -> None:
    frozen = depth(1.5)
    z = [frozen if n in (1, 2, 3) else depth(1 + n / 4) for n in range(6)]
    rgb = [colour(20 * n) for n in range(6)]
    assert known(rgb, z) == ([True, True, False, False, True, True], 2)


def test_frozen_colour_is_noticed_until_it_changes() -> None:
    frozen = colour(80)
    rgb = [frozen if n in (1, 2, 3) else colour(20 * n) for n in range(6)]
    z = [depth(1 + n / 4) for n in range(6)]
    assert known(rgb, z) == ([True, True, False, False, True, True], 2)


def test_a_camera_that_stands_still_is_not_frozen() -> None:
    same, still = depth(1.5), colour(100)
    assert known([colour(100) for _ in range(5)], [same] * 5) == ([True] * 5, 0)
    assert known([still] * 5, [depth(1.5) for _ in range(5)]) == ([True] * 5, 0)
    assert known([still] * 5, [same] * 5) == ([True] * 5, 0)
