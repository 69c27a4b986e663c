"""Inverse sensor model: the floor evidence of one depth frame. Pure functions.

Each pixel is a point on the floor, on an obstacle, or above both. Between two neighbours of one
image column that both lie on the floor, the floor is free too; between two on the same obstacle,
the obstacle continues. The space that a ray passes is not used, since rays pass over tables.

After Moravec and Elfes (ICRA 1985) and Thrun, Burgard and Fox (Probabilistic Robotics, 2005,
chapter 9), with image columns in place of their sensor's cone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.occupancy.occupancy_settings import OccupancySettings

_LEVEL: Final = 0.25  # greatest slope of a level surface; the slope of walls is far greater
_MIDDLE: Final = 0.25  # half side of the middle of a larger cell, whose view counts for all of it
_INTERPOLATED: Final = np.arange(1, 4)[:, None] / 4  # shares of the way between two neighbours

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FramePoints:
    """Point cloud of a frame in the map, on a grid of every few pixels."""

    xyz: Floats  # (3, rows, columns) [m] map frame, nan where there is no depth to rely on
    depth: Floats  # (rows, columns) [m]


@dataclass(frozen=True, slots=True, eq=False)
class FloorEvidence:
    """Floor evidence of one frame, for whole tiles around its camera; cells are (x, y)."""

    tile: tuple[int, int]  # number of the first tile
    free: NDArray[np.bool_]  # (n, n)
    hit: NDArray[np.bool_]  # (n, n) obstacle
    tall: NDArray[np.bool_]  # (n, n) obstacle that cannot be looked over
    viewed: NDArray[np.bool_]  # (2, n / view, n / view) surface in view from close by, and at all


def frame_points(
    depth: NDArray[np.float32], K: Floats, T_map_cam: Floats, settings: OccupancySettings
) -> FramePoints:
    """Point cloud of a frame; `depth` (h, w) [m], `K` (3, 3) [px], `T_map_cam` (4, 4).

    Pixels on depth edges are left out, since their depth often belongs to neither side.
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
    return FramePoints(xyz, z)


def floor_evidence(
    points: FramePoints, camera: Floats, floor: float, settings: OccupancySettings
) -> FloorEvidence:
    """Evidence of `points`, seen from `camera` (3,) [m], on a floor at height `floor` [m]."""
    s = settings
    first, second = (int(np.floor((c - s.far) / s.span)) for c in camera[:2])
    cells = s.side * (int(np.ceil(2 * s.far / s.span)) + 1)
    height = points.xyz[2] - floor
    level = s.level + s.level_growth * points.depth
    with np.errstate(invalid="ignore"):
        on_floor = abs(height) <= level
        obstacle = (height > level + s.clearance) & (height < s.top)
        above_eyes = obstacle & (height > s.eye)
        in_reach = (height > -level) & (height < s.top) & _level(points)
        close = in_reach & (points.depth <= s.close)
    corner = np.array([first, second]) * s.span
    xy = (points.xyz[:2] - corner[:, None, None]) / s.cell
    with np.errstate(invalid="ignore"):
        joined = abs(np.diff(points.depth, axis=0)) <= s.thing

    def count(chosen: NDArray[np.bool_], pairs: NDArray[np.bool_]) -> NDArray[np.intp]:
        return _histogram(_with_interpolated(xy, chosen, pairs), cells)

    obstacles = count(obstacle, joined)
    hit = obstacles >= s.hits
    free = (count(on_floor, np.ones_like(joined)) > 0) & (obstacles == 0)
    tall = hit & (count(above_eyes, joined) >= s.hits)
    viewed = np.zeros((2, cells // s.view, cells // s.view), np.bool_)
    at = xy[:, in_reach] / s.view
    larger = np.floor(at)
    inside = ((larger >= 0) & (larger < len(viewed[0])) & (abs(at - larger - 0.5) <= _MIDDLE)).all(
        0
    )
    column, row = larger[:, inside].astype(np.intp)
    viewed[1, column, row] = True
    near = close[in_reach][inside]
    viewed[0, column[near], row[near]] = True
    return FloorEvidence((first, second), free, hit, tall, viewed)


def _level(points: FramePoints) -> NDArray[np.bool_]:
    """(rows, columns) whether a point lies on a level surface, by its neighbour above it.

    Floors and tops are level. Walls and fronts are not, and hide the floor behind them.
    """
    with np.errstate(invalid="ignore"):
        step = np.diff(points.xyz, axis=1)
        flat = step[2] ** 2 < _LEVEL**2 * (step[0] ** 2 + step[1] ** 2)
    return np.concatenate([np.zeros_like(flat[:1]), flat])


def _with_interpolated(xy: Floats, chosen: NDArray[np.bool_], joined: NDArray[np.bool_]) -> Floats:
    """Chosen points and interpolated ones between vertical neighbours, (2, n) [cells]."""
    both = np.flatnonzero(chosen[:-1] & chosen[1:] & joined)
    points = xy.reshape(2, -1)
    low, high = points.take(both + chosen.shape[1], axis=1), points.take(both, axis=1)
    between = low[:, None, :] + _INTERPOLATED * (high - low)[:, None, :]
    some = points.take(np.flatnonzero(chosen), axis=1)
    return np.concatenate([some, between.reshape(2, -1)], axis=1)


def _histogram(xy: Floats, cells: int) -> NDArray[np.intp]:
    """2D histogram (cells, cells) of points (2, n) [cells]."""
    x, y = np.floor(xy)
    inside = (x >= 0) & (x < cells) & (y >= 0) & (y < cells)
    at = (x * cells + y)[inside].astype(np.intp)
    return np.bincount(at, minlength=cells * cells).reshape(cells, cells)
