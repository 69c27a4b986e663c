"""Visibility: field of view and occlusion of a registered object (thesis eq. 3.2 and 3.3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.frames.projection import project, to_camera
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame

Floats = NDArray[np.float64]


def in_field_of_view(p_cam: Floats, K: Floats, shape: tuple[int, int]) -> bool:
    """Field-of-view test, eq. 3.2: whether `p_cam` (3,) [m] is ahead and within both angles.

    The angles are the camera's own, from `K` and the image's (height, width): with the principal
    point off the centre they differ to the left and right, and the test equals "falls on a pixel".
    """
    x, y, z = (float(v) for v in p_cam)
    if not z > 0:
        return False
    return _within(math.atan(x / z), K[0, 0], K[0, 2], shape[1]) and _within(
        math.atan(y / z), K[1, 1], K[1, 2], shape[0]
    )


def _within(angle: float, focal: float, centre: float, pixels: int) -> bool:
    return -math.atan((centre + 0.5) / focal) < angle < math.atan((pixels - 0.5 - centre) / focal)


def window(depth: NDArray[np.float32], row: int, column: int, size: int) -> NDArray[np.float32]:
    """Window W of eq. 3.3: the known depths (n,) [m] in a `size` x `size` square about a pixel."""
    top, left = row - size // 2, column - size // 2
    patch = depth[max(top, 0) : max(top + size, 0), max(left, 0) : max(left + size, 0)]
    return np.asarray(patch[patch > 0], dtype=np.float32)


def occluded(depths: NDArray[np.float32], z: float, tolerance: float) -> bool:
    """Occlusion test, eq. 3.3: whether any depth of the window is nearer than the object's `z` [m].

    The text's rule is strict (`tolerance` 0): an object's own front counts as an occluder where
    its mean lies deeper. A tolerance [m] lets it be seen.
    """
    return bool(np.any(depths < z - tolerance))


def missed(frame: Frame, p_map: Floats, settings: ReferenceSettings) -> bool:
    """Negative evidence: whether an undetected object at `p_map` (3,) [m] was visible in `frame`.

    It must lie in the field of view (3.2), in the sensor's good depth range, show depth around its
    pixel, and be unoccluded (3.3).
    """
    p_cam = to_camera(frame.T_map_cam, p_map)
    z = float(p_cam[2])
    if not settings.min_depth <= z <= settings.max_depth:
        return False
    if not in_field_of_view(p_cam, frame.K, frame.depth.shape):
        return False
    depths = window(frame.depth, *project(p_cam, frame.K), settings.occlusion_window)
    return len(depths) > 0 and not occluded(depths, z, settings.occlusion_tolerance)
