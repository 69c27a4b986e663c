"""Ray test: whether a frame shows an object's place, with something there or empty."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from mapping.frames.projection import to_camera
from mapping.objects.settings import ObjectSettings
from perception.frames import Frame

Floats = NDArray[np.float64]


class VolumeView(Enum):
    """View of a volume in a frame."""

    NOTHING = "not in view, hidden, or cut by the border"
    SURFACE = "rays end inside it"
    EMPTY = "rays go through it"


def in_front(frame: Frame, positions: Floats, settings: ObjectSettings) -> NDArray[np.intp]:
    """Indices of the positions (n, 3) [m] that project into the image, within range."""
    if not len(positions):
        return np.zeros(0, dtype=np.intp)
    p_cam = to_camera(frame.T_map_cam, positions)
    depth = p_cam[:, 2]
    near, far = settings.nearest_sight, settings.farthest_sight
    height, width = frame.depth.shape
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = frame.K[0, 0] * p_cam[:, 0] / depth + frame.K[0, 2]
        rows = frame.K[1, 1] * p_cam[:, 1] / depth + frame.K[1, 2]
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.nonzero((depth > near) & (depth < far) & inside)[0]


def ray_test(frame: Frame, p_map: Floats, size: float, settings: ObjectSettings) -> VolumeView:
    """View in `frame` of a volume of side `size` [m] around `p_map` (3,) [m]."""
    s = settings
    x, y, depth = to_camera(frame.T_map_cam, p_map)
    half = size / 2 * frame.K[0, 0] / depth
    column = frame.K[0, 0] * x / depth + frame.K[0, 2]
    row = frame.K[1, 1] * y / depth + frame.K[1, 2]
    height, width = frame.depth.shape
    margin = half + s.sight_margin
    if not (margin <= column <= width - margin and margin <= row <= height - margin):
        return VolumeView.NOTHING
    reach, step = max(0.6 * half, 3.0), max(1, int(half / 10))
    top, left = int(row - reach), int(column - reach)
    depths = frame.depth[
        max(top, 0) : int(row + reach) + 1 : step, max(left, 0) : int(column + reach) + 1 : step
    ]
    depths = depths[depths > 0]
    if len(depths) < 4:
        return VolumeView.NOTHING
    tolerance = 0.5 * size + s.ray_tolerance + s.ray_noise * depth**2
    before = float((depths < depth - tolerance).mean())
    beyond = float((depths > depth + tolerance).mean())
    if before > s.occluded:
        return VolumeView.NOTHING
    if beyond > s.empty:
        return VolumeView.EMPTY
    return VolumeView.SURFACE if 1 - before - beyond > 0.4 else VolumeView.NOTHING
