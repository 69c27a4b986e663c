"""What can be seen over the floor from where: straight lines that no wall interrupts."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.freespace.grid import Cells, FreeSpace


@lru_cache(maxsize=8)
def _lines(cells: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Offsets (k, 2) within `cells` of the middle, and the cells (k, m, 2) that lie between.

    What lies between two cells is the same from either end.
    """
    span = np.arange(-cells, cells + 1)
    offsets = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    offsets = offsets[(offsets**2).sum(axis=1) <= cells**2]
    steps = 2 * cells
    share = np.arange(1, steps) / steps
    between = np.rint(offsets[:, None, :] * share[None, :, None]).astype(np.intp)
    back = (offsets[:, 0] < 0) | ((offsets[:, 0] == 0) & (offsets[:, 1] < 0))
    forth = {tuple(offset): row for row, offset in enumerate(offsets.tolist())}
    for row in np.flatnonzero(back):  # halves round one way only: take the other end's cells
        opposite = forth[tuple((-offsets[row]).tolist())]
        between[row] = between[opposite] + offsets[row]
    return offsets, between


@lru_cache(maxsize=8)  # a picture is asked about for the belief, and for what was viewed
def visible_cells(space: FreeSpace, cell: int, reach: float) -> tuple[Cells, NDArray[np.float64]]:
    """Cells seen from the middle of `cell` within `reach` metres, and the offsets to them.

    The offsets are (n, 2) [m]. Every line of sight is sampled twice a cell; what it meets between
    its ends must hide nothing (`FreeSpace.open`).
    """
    radius = int(np.floor(reach / space.cell + 1e-9))
    offsets, between = _lines(radius)
    nx, ny = space.shape
    at = np.array(divmod(cell, ny))
    target = at + offsets
    inside = (target >= 0).all(axis=1) & (target[:, 0] < nx) & (target[:, 1] < ny)
    offsets, between, target = offsets[inside], between[inside], target[inside]
    inside_floor = space.open[target[:, 0], target[:, 1]]
    offsets, between, target = offsets[inside_floor], between[inside_floor], target[inside_floor]
    path = at + between
    clear = space.open[path[..., 0], path[..., 1]].all(axis=1)
    cells = target[clear, 0] * ny + target[clear, 1]
    return np.asarray(cells, np.intp), np.asarray(offsets[clear] * space.cell, np.float64)
