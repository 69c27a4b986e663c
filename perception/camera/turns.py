"""Quarter turns: images of a camera that is mounted or held on its side, turned upright."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import Pose

#: takes coordinates of a camera turned by a quarter (counter-clockwise) to those of the camera
QUARTER: Final = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
CLEAR: Final = 0.8  # share of the images, by how much of up they show, that must agree
ASIDE: Final = 1.5  # times that the axis down must turn more than that to the right
TURNED: Final = 0.15  # mean turn [rad] of a camera that looked around
SHOWN: Final = 0.3  # mean length of up in the image's plane; less where cameras look down


def upright_turns(poses: Sequence[Pose], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (4,) of the quarters, counter-clockwise, that bring `up` to the top of images."""
    shown = np.array([T[:3, :3].T @ up for T in poses])  # (n, 3) in the cameras
    quarters = np.round(np.arctan2(shown[:, 0], -shown[:, 1]) / (np.pi / 2)).astype(int) % 4
    return np.bincount(quarters, np.hypot(shown[:, 0], shown[:, 1]), 4).astype(np.float64)


def clear_turns(poses: Sequence[Pose], up: NDArray[np.float64]) -> int:
    """Quarters that turn the images upright; 0 where the images do not agree on it."""
    weights = upright_turns(poses, up)
    best = int(weights.argmax())
    clear = weights[best] >= CLEAR * weights.sum() and weights.sum() >= SHOWN * len(poses)
    return best if clear else 0


def side_up(poses: Sequence[Pose]) -> NDArray[np.float64] | None:
    """Up (3,), or down, of a world in which the camera seems to be held on its side; else None.

    A camera that looks around a room turns about the vertical, so of the axes of its image the
    level one turns most. Held upright that is the axis to the right, held on its side the axis
    down. Where a camera hardly turns, neither does by `ASIDE`.
    """
    right, down = (np.array([T[:3, axis] for T in poses]) for axis in (0, 1))
    across, _ = np.linalg.eigh(right.T @ right / len(poses))  # squared spreads, ascending
    along, directions = np.linalg.eigh(down.T @ down / len(poses))
    if along[1] < max(ASIDE**2 * across[1], TURNED**2):
        return None
    vertical: NDArray[np.float64] = directions[:, 0]
    return vertical


def turned_poses(T: Pose, turns: int) -> Pose:
    """Pose of the turned camera."""
    turned: Pose = T @ np.linalg.matrix_power(QUARTER, turns)
    return turned


def turned_image(image: NDArray[Any], turns: int) -> NDArray[Any]:
    """An image turned counter-clockwise by quarters."""
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def turned_camera(camera: Intrinsics, turns: int) -> Intrinsics:
    """Intrinsics of the turned images of a camera without distortion, of known size."""
    (width, height), fx, fy, cx, cy = camera.size, camera.fx, camera.fy, camera.cx, camera.cy
    for _ in range(turns):
        fx, fy, cx, cy = fy, fx, cy, width - 1 - cx
        width, height = height, width
    return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height)
