"""Odometry noise: estimated poses that drift away from the true ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import rotation_angle


def with_drift(
    poses: Iterable[NDArray[np.float64]], share: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float64]]:
    """Poses T_world_cam (4, 4) estimated by odometry; the first one is true.

    Each step has an error in position of `share` of its length (standard deviation, horizontal),
    and in heading of `share` of its turn and `share` times 15 degrees a metre (Thrun, Burgard and
    Fox, Probabilistic Robotics, section 5.4). A share of 0 gives the true poses.
    """
    previous: NDArray[np.float64] | None = None
    estimate = np.eye(4)
    for T in poses:
        if previous is None:
            estimate = T.copy()
        else:
            step = np.linalg.inv(previous) @ T
            estimate = _disturbed(estimate @ step, step, share, rng)
        previous = T
        yield estimate.copy()


def _disturbed(
    T: NDArray[np.float64], step: NDArray[np.float64], share: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    distance = float(np.linalg.norm(step[:3, 3]))
    turn = rotation_angle(step[:3, :3])
    angle = share * np.hypot(turn, np.deg2rad(15.0) * distance) * rng.standard_normal()
    out = T.copy()
    c, s = np.cos(angle), np.sin(angle)
    out[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ T[:3, :3]
    out[:2, 3] += share * distance * rng.standard_normal(2)
    return out
