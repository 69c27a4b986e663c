"""Surface growth: the voxels of the surface that belong to a thing, and a box around them.

A voxel belongs to a thing if most views that show its place have it inside the thing's box and near
the thing's depth. Things before or behind it leave the boxes as the camera moves. A level
surface that makes up much of the thing, as the top of a table, is followed to its edges, unless it
goes on far beyond the thing: what carries a thing is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.oriented_boxes import OrientedBox
from mapping.objects.extents.box_views import BoxViews
from perception.binary_masks import connected_components

MIN_SHARE: Final = 0.6  # of the views that show a voxel's place and have it in the thing
_OUTSIDE: Final = 0.05  # share of its voxels beyond each side of a box
_MIN_VOXELS: Final = 3
_MAX_VOXELS: Final = 2000  # that are looked at
_LEVEL: Final = 0.4  # share of a thing's voxels in a level surface that is followed
_LAYERS: Final = 3  # voxels, the thickness of a level surface
_BEYOND: Final = 2.0  # times as many cells as the thing showed, a level surface is no part of it
_THICK: Final = 0.375  # share of its longer side by which a thing's depth may differ, ...
_THICKNESS: Final = (0.15, 1.5)  # [m] ... between these bounds
_AWAY: Final = 2.0  # times as far from its depth, a voxel is no part of it
_MIN_SIDE: Final = 0.02  # [m]
_TURNS: Final = np.radians(np.arange(0, 90, 3))  # tried orientations
_MUCH_SMALLER: Final = 0.75  # share of the footprint parallel to walls, below which a turn is clear

Floats = NDArray[np.float64]
#: centres (n, 3) [m] of the surface's voxels between two corners (3,) [m], and their side [m]
Voxels = Callable[[Floats, Floats], tuple[Floats, float]]


def grown_box(
    surface: Voxels, low: Floats, high: Floats, views: BoxViews, yaw: float | None = None
) -> OrientedBox | None:
    """An upright box around a thing's voxels; None where it has hardly any.

    It is parallel to the walls, which stand at `yaw` [rad], unless another box is much smaller.
    `low` and `high` (3,) [m] are corners of the space where the thing was seen.
    """
    voxels, size = surface(low, high)
    step = max(1, len(voxels) // _MAX_VOXELS)
    voxels = voxels[::step]
    held = voxels[_belong(voxels, size, views)]
    if len(held) < _MIN_VOXELS:
        return None
    return _box_around(_to_the_edges(held, surface, size), yaw)


def _belong(voxels: Floats, size: float, views: BoxViews) -> NDArray[np.bool_]:
    """(n,) which voxels are part of the thing."""
    pixels, depth = views.project(voxels)
    shown = (depth > size) & ((pixels >= 0) & (pixels < views.size[:, None])).all(2)
    slack = size / 2 * views.focal[:, :1] / np.maximum(depth, size)
    low, high = views.boxes[:, None, :2], views.boxes[:, None, 2:]
    inside = ((pixels >= low - slack[..., None]) & (pixels <= high + slack[..., None])).all(2)
    side = views.depth * (views.sides / views.focal).max(1)
    thickness = np.clip(_THICK * side, *_THICKNESS)[:, None]
    beyond = np.abs(depth - views.depth[:, None])
    part = shown & inside & (beyond < thickness)
    other = shown & (~inside | (beyond > _AWAY * thickness))
    votes = part.sum(0)
    return np.asarray((votes >= min(2, len(views))) & (votes >= MIN_SHARE * (votes + other.sum(0))))


def _to_the_edges(held: Floats, surface: Voxels, size: float) -> Floats:
    """Voxels of a thing, with all of its level surface where it has one."""
    layer = np.floor(held[:, 2] / size).astype(np.int64)
    counts = np.convolve(np.bincount(layer - layer.min()), np.ones(_LAYERS), "same")
    middle = (int(counts.argmax()) + layer.min() + 0.5) * size
    level = np.abs(held[:, 2] - middle) < _LAYERS / 2 * size
    if level.sum() < _LEVEL * len(held):
        return held
    low, high = held[level].min(0), held[level].max(0)
    reach = np.array([*(_BEYOND / 2 * (high - low)[:2].max(keepdims=True)).repeat(2), 0.0])
    low[2], high[2] = middle - _LAYERS // 2 * size, middle + _LAYERS // 2 * size
    slab, _ = surface(low - reach, high + reach)
    column, row = np.floor((slab[:, :2] - slab[:, :2].min(0)) / size + 0.5).astype(np.int64).T + 1
    solid = np.zeros((column.max(initial=0) + 2, row.max(initial=0) + 2), np.bool_)
    solid[column, row] = True
    shown = solid.copy()
    inside = ((slab[:, :2] >= low[:2]) & (slab[:, :2] <= high[:2])).all(1)
    shown[column[~inside], row[~inside]] = False
    parts = connected_components(solid)
    joined = np.isin(parts, np.unique(parts[shown]))
    if joined.sum() > _BEYOND * shown.sum():
        return held
    return np.concatenate([held[~level], slab[joined[column, row]]])


def _box_around(voxels: Floats, yaw: float | None) -> OrientedBox:
    """The box of least footprint around most of the voxels (n, 3) [m], or that at `yaw`."""
    middle = voxels[:, :2].mean(0)
    turns = _TURNS if yaw is None else np.append(_TURNS, yaw)
    c, s = np.cos(turns), np.sin(turns)
    axes = np.moveaxis(np.array([(c, -s), (s, c)]), 2, 0)  # (turns, 2, 2)
    low, high = _between((voxels[:, :2] - middle) @ axes)
    sides = np.maximum(high - low, _MIN_SIDE)
    areas = sides.prod(1)
    best = int(areas.argmin())
    if yaw is not None and areas[best] > _MUCH_SMALLER * areas[-1]:
        best = len(turns) - 1
    bottom, top = _between(voxels[:, 2:])
    centre = middle + axes[best] @ (low[best] + high[best]) / 2
    extent = np.array([*sides[best], max(float(top[0] - bottom[0]), _MIN_SIDE)])
    return OrientedBox(np.array([*centre, (bottom[0] + top[0]) / 2]), extent, float(turns[best]))


def _between(values: Floats) -> tuple[Floats, Floats]:
    """Bounds (..., k) of `values` (..., n, k) without the outermost share on each side."""
    rank = int(_OUTSIDE * (values.shape[-2] - 1) + 0.5)
    ordered = np.sort(values, axis=-2)
    return ordered[..., rank, :], ordered[..., -1 - rank, :]
