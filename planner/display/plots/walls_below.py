"""Test whether text would lie over walls."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from planner.display.plots.label_placement import Boxes


class WallsBelow:
    """Tells which boxes on the page [px] lie over walls.

    By a summed-area table (Crow 1984), so that a box costs the same however large it is.
    """

    def __init__(
        self, walls: NDArray[np.bool_], corner: NDArray[np.float64], cell: float, axes: Axes
    ) -> None:
        """`walls` (nx, ny) are cells of the side `cell` [m] from `corner` (2,) [m] on."""
        self._corner, self._cell = corner, cell
        self._to_map = axes.transData.inverted()
        counted = walls.cumsum(axis=0, dtype=np.int32).cumsum(axis=1)
        self._sums = np.pad(counted, ((1, 0), (1, 0)))  # [i, j]: of cells below i and j

    def __call__(self, boxes: Boxes) -> NDArray[np.bool_]:
        """(k,) whether a cell of a wall lies below each of `boxes` (k, 4) [px]."""
        low = self._cells(boxes[:, :2], np.floor)
        high = self._cells(boxes[:, 2:], np.ceil)
        (i0, j0), (i1, j1) = low.T, high.T
        sums = self._sums
        return np.asarray(sums[i1, j1] - sums[i0, j1] - sums[i1, j0] + sums[i0, j0] > 0)

    def _cells(self, corners: Boxes, rounding: np.ufunc) -> NDArray[np.intp]:
        cells = rounding((self._to_map.transform(corners) - self._corner) / self._cell)
        return np.asarray(np.clip(cells, 0, np.array(self._sums.shape) - 1), np.intp)


def wall_cells(
    walls: NDArray[np.float64], corners: NDArray[np.float64], cell: float
) -> NDArray[np.bool_]:
    """The cells between two `corners` (2, 2) [m] that pieces of wall (w, 2, 2) [m] run through."""
    found = np.zeros(np.ceil((corners[1] - corners[0]) / cell).astype(int) + 1, np.bool_)
    for start, end in walls:
        count = int(np.ceil(np.linalg.norm(end - start) / cell)) + 1
        at = np.rint((np.linspace(start, end, count) - corners[0]) / cell).astype(int)
        i, j = at[((at >= 0) & (at < found.shape)).all(axis=1)].T
        found[i, j] = True
    return found
