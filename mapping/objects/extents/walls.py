"""Walls around a thing: which way they stand, and how far a box may reach before one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from kg.model.oriented_boxes import OrientedBox, along

REACH: Final = np.array([2.0, 2.0, 0.6])  # [m] around a thing in which walls are looked for
_TALL: Final = 0.5  # [m] of surface above each other from which on a column is upright
_CLEAR: Final = 1.5  # times the median score, that of the best direction at least
_STEP: Final = 3.0  # [deg] between tried directions, before the best is refined to a degree
_LONG: Final = 0.8  # [m] of upright surface in line beside a box, from which on it is a wall

Floats = NDArray[np.float64]


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

    def score(turn: float) -> float:
        c, s = np.cos(turn), np.sin(turn)
        cells = np.floor(relative @ np.array([(c, -s), (s, c)]) / size).astype(np.int64)
        return sum(float((np.bincount(row) ** 2).sum()) for row in (cells - cells.min(0)).T)

    scores = {float(turn): score(turn) for turn in np.radians(np.arange(0.0, 90.0, _STEP))}
    usual, coarse = np.median([*scores.values()]), max(scores, key=scores.__getitem__)
    for turn in np.radians(np.arange(1 - _STEP, _STEP)) + coarse:
        scores[float(turn % (np.pi / 2))] = score(turn)
    best = max(scores, key=scores.__getitem__)
    return best if scores[best] >= _CLEAR * usual else None
