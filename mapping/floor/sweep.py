"""What one depth frame says of the floor around its camera. Pure.

Each pixel is a point above the floor: on it, on something that stands in the way, or above both.
Two neighbours in one column of the picture that both lie on the floor leave nothing between them,
so that the floor between is free too; two on the same thing have it between them. Nothing else is
concluded from what a ray passes, since a ray passes over tables. After Moravec and Elfes (ICRA
1985) and Thrun, Burgard and Fox (Probabilistic Robotics, 2005, chapter 9), with the picture in
place of their sensor's cone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.floor.settings import FloorSettings

_BETWEEN: Final = np.arange(1, 4)[:, None] / 4  # of two neighbours, what lies between them

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Every few pixels of a frame in the map."""

    xyz: Floats  # (3, rows, columns) [m] map frame, nan where there is no depth to rely on
    depth: Floats  # (rows, columns) [m]


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What one frame says of whole tiles around its camera; cells are (x, y)."""

    tile: tuple[int, int]  # number of the first tile
    free: NDArray[np.bool_]  # (n, n)
    hit: NDArray[np.bool_]  # (n, n) something stands there
    tall: NDArray[np.bool_]  # (n, n) of it what cannot be looked over


def points_of(
    depth: NDArray[np.float32], K: Floats, T_map_cam: Floats, settings: FloorSettings
) -> Points:
    """Points of a frame; `depth` (h, w) [m], `K` (3, 3) [px], `T_map_cam` (4, 4).

    Pixels on the edges of things are left out: their depth is often that of neither side.
    """
    s = settings
    step = max(1, round(depth.shape[1] / s.columns))
    first = step // 2
    here = depth[first:-1:step, first:-1:step].astype(np.float64)
    right = depth[first:-1:step, first + 1 :: step][: here.shape[0], : here.shape[1]]
    below = depth[first + 1 :: step, first:-1:step][: here.shape[0], : here.shape[1]]
    with np.errstate(invalid="ignore"):
        known = (here >= s.near) & (here <= s.far)
        known &= np.maximum(abs(right - here), abs(below - here)) <= s.edge * here
    z = np.where(known, here, np.nan)
    u = (first + step * np.arange(here.shape[1]) - K[0, 2]) / K[0, 0]
    v = (first + step * np.arange(here.shape[0]) - K[1, 2]) / K[1, 1]
    p_cam = np.stack([z * u, z * v[:, None], z])
    xyz = np.einsum("ij,jrc->irc", T_map_cam[:3, :3], p_cam) + T_map_cam[:3, 3, None, None]
    return Points(xyz, z)


def sweep(points: Points, camera: Floats, floor: float, settings: FloorSettings) -> Sweep:
    """What `points` say, seen from `camera` (3,) [m], above a floor at height `floor` [m]."""
    s = settings
    first, second = (int(np.floor((c - s.far) / s.span)) for c in camera[:2])
    cells = s.side * (int(np.ceil(2 * s.far / s.span)) + 1)
    height = points.xyz[2] - floor
    level = s.level + s.level_growth * points.depth
    with np.errstate(invalid="ignore"):
        on_floor = abs(height) <= level
        in_the_way = (height > level + s.clearance) & (height < s.top)
        above_eyes = in_the_way & (height > s.eye)
    corner = np.array([first, second]) * s.span
    xy = (points.xyz[:2] - corner[:, None, None]) / s.cell
    with np.errstate(invalid="ignore"):
        near = abs(np.diff(points.depth, axis=0)) <= s.thing

    def count(chosen: NDArray[np.bool_], joined: NDArray[np.bool_]) -> NDArray[np.intp]:
        return _counted(_with_between(xy, chosen, joined), cells)

    things = count(in_the_way, near)
    hit = things >= s.hits
    free = (count(on_floor, np.ones_like(near)) > 0) & (things == 0)
    tall = hit & (count(above_eyes, near) >= s.hits)
    return Sweep((first, second), free, hit, tall)


def _with_between(xy: Floats, chosen: NDArray[np.bool_], joined: NDArray[np.bool_]) -> Floats:
    """(2, n) the chosen points, and what lies between two of them, one above the other."""
    both = chosen[:-1] & chosen[1:] & joined
    low, high = xy[:, 1:][:, both], xy[:, :-1][:, both]
    between = low[:, None, :] + _BETWEEN * (high - low)[:, None, :]
    return np.concatenate([xy[:, chosen], between.reshape(2, -1)], axis=1)


def _counted(xy: Floats, cells: int) -> NDArray[np.intp]:
    """(cells, cells) how many of the points (2, n), in cells, lie in each."""
    at = np.floor(xy).astype(np.intp)
    at = at[:, ((at >= 0) & (at < cells)).all(axis=0)]
    return np.bincount(at[0] * cells + at[1], minlength=cells * cells).reshape(cells, cells)
