"""Surface growth: a box around the voxels that belong to a thing, up to the walls around it.

A voxel belongs to a thing if most views that show its place have it inside the thing's box and near
the thing's depth. Things before or behind it leave the boxes as the camera moves. A level
surface that makes up much of the thing, as the top of a table, is followed to its edges, unless it
goes on far beyond the thing: what carries a thing is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import OrientedBox, along
from mapping.objects.extents.box_fit import BoxViews
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


REACH: Final = np.array([2.0, 2.0, 0.6])  # [m] around a thing in which walls are looked for
_TALL: Final = 0.5  # [m] of surface above each other from which on a column is upright
_CLEAR: Final = 1.5  # times the median score, that of the best direction at least
_STEP: Final = 3.0  # [deg] between tried directions, before the best is refined to a degree
_LONG: Final = 0.8  # [m] of upright surface in line beside a box, from which on it is a wall


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Upright surfaces in line with each other; cupboards count as walls do."""

    columns: Floats  # (n, 2) [m] middles of upright columns of voxels
    tops: Floats  # (n,) [m] their upper ends
    size: float  # [m] side of a voxel
    yaw: float  # [rad] from 0 to a quarter turn, in which most columns line up

    @classmethod
    def of(cls, voxels: Floats, size: float) -> Self | None:
        """The walls that `voxels` (n, 3) [m] make up; None where none stand in line."""
        cells = np.floor(voxels[:, :2] / size).astype(np.int64)
        cells -= cells.min(0, initial=0)
        keys = cells[:, 0] * (cells[:, 1].max(initial=0) + 1) + cells[:, 1]
        order = np.argsort(keys)
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        tall = np.diff(starts, append=len(keys)) * size >= _TALL
        if not tall.any():
            return None
        columns = voxels[order[starts[tall]], :2]
        tops = np.maximum.reduceat(voxels[order, 2], starts)
        yaw = _direction(columns, size)
        return None if yaw is None else cls(columns, tops[tall], size, yaw)

    def kept_before(self, box: OrientedBox, grown: OrientedBox) -> OrientedBox:
        """`box`, which stands as the walls do, cut where it passes through one beside it.

        Nothing is cut of `grown`, the part of the thing that the surface shows.
        """
        columns = self.columns[self.tops >= box.centre[2]] - box.centre[:2]
        relative = along(np.pad(columns, ((0, 0), (0, 1))), box.yaw)[:, :2]
        offset = along(grown.centre - box.centre, box.yaw)[:2]
        half = box.extent[:2] / 2
        low, high = -half, half.copy()
        least, most = offset - grown.extent[:2] / 2, offset + grown.extent[:2] / 2
        for axis in range(2):
            across, beside = relative[:, axis], np.abs(relative[:, 1 - axis]) > half[1 - axis]
            lines, counts = np.unique(
                np.floor(across[beside] / self.size).astype(np.int64), return_counts=True
            )
            walls = (lines[counts * self.size >= _LONG] + 0.5) * self.size
            low[axis] = max([low[axis], *np.minimum(walls[walls < 0], least[axis])])
            high[axis] = min([high[axis], *np.maximum(walls[walls > 0], most[axis])])
        middle = np.array([*(low + high) / 2, 0.0])
        extent = np.array([*(high - low), box.extent[2]])
        return OrientedBox(box.centre + along(middle, -box.yaw), extent, box.yaw)


def _direction(columns: Floats, size: float) -> float | None:
    """Yaw [rad] in which straight walls fill few cells of the profiles across them."""
    relative = columns - columns.mean(0)

    def scores_of(turns: Floats) -> dict[float, float]:
        c, s = np.cos(turns), np.sin(turns)
        axes = np.concatenate([(c, s), (-s, c)], axis=1)  # (2, 2 k) both directions of each turn
        cells = np.floor(relative @ axes / size).astype(np.int64)
        cells -= cells.min(0)
        profiles = cells.max(0) + 1
        starts = np.cumsum(profiles) - profiles
        squares = np.bincount((cells + starts).ravel(), minlength=int(profiles.sum())) ** 2
        by_axis = np.add.reduceat(squares, starts).reshape(2, -1)
        return dict(zip(turns.tolist(), by_axis.sum(0).astype(float).tolist(), strict=True))

    scores = scores_of(np.radians(np.arange(0.0, 90.0, _STEP)))
    usual, coarse = np.median([*scores.values()]), max(scores, key=scores.__getitem__)
    scores |= scores_of((np.radians(np.arange(1 - _STEP, _STEP)) + coarse) % (np.pi / 2))
    best = max(scores, key=scores.__getitem__)
    return best if scores[best] >= _CLEAR * usual else None
