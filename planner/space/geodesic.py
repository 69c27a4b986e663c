"""How far it is by foot: shortest ways over the grid, from many cells at once.

Distances are those of the grid's 16 directions (at most 2.8 % above the true ones), found by sweeps
over rows and columns that update all sources together, until nothing changes any more.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.errors import LayoutError
from planner.space.grid import FreeSpace

_DIAGONAL: Final = float(np.sqrt(2))
_KNIGHT: Final = float(np.sqrt(5))
_STEPS: Final = (*((1, 0), (-1, 0), (0, 1), (0, -1)), *((1, 1), (1, -1), (-1, 1), (-1, -1)))


def distance_fields(space: FreeSpace, sources: ArrayLike) -> NDArray[np.float32]:
    """(n, nx, ny) [m] the shortest way from each of the n cells `sources` to every cell.

    Infinite where no way leads, and on what is no floor.
    """
    cells = np.asarray(sources, np.intp).reshape(-1)
    metres = np.full((len(cells), *space.shape), np.inf, np.float32)
    metres.reshape(len(cells), -1)[np.arange(len(cells)), cells] = 0.0
    steps = _Steps(space.free)
    while True:
        before = metres.copy()
        for axis in (1, 2):
            for forward in (True, False):
                steps.sweep(metres, axis, forward)
        _through_passages(space, metres)
        if np.array_equal(before, metres):
            return metres * np.float32(space.cell)


class _Steps:
    """Moves of one row to the next, where walls allow them."""

    def __init__(self, free: NDArray[np.bool_]) -> None:
        self._free = {1: free, 2: free.T}

    def sweep(self, metres: NDArray[np.float32], axis: int, forward: bool) -> None:
        """Carry distances from row to row along `axis`, one way."""
        rows = metres if axis == 1 else metres.transpose(0, 2, 1)
        free = self._free[axis]
        order = range(1, len(free)) if forward else range(len(free) - 2, -1, -1)
        for row in order:
            last = row - 1 if forward else row + 1
            self._carry(rows, free, last, row)

    @staticmethod
    def _carry(rows: NDArray[np.float32], free: NDArray[np.bool_], last: int, row: int) -> None:
        known, here = rows[:, last], rows[:, row].copy()
        np.minimum(here, known + np.float32(1), out=here)
        for side in (1, -1):
            near, far = _shift(free, last, row, side)
            step = _shifted(known, side) + np.float32(_DIAGONAL)
            np.minimum(here, np.where(near, step, np.inf), out=here)
            leap = _shifted(known, 2 * side) + np.float32(_KNIGHT)
            np.minimum(here, np.where(far, leap, np.inf), out=here)
        here[:, ~free[row]] = np.inf
        rows[:, row] = here


def _shifted(row: NDArray[np.float32], by: int) -> NDArray[np.float32]:
    """Each entry's neighbour `by` columns before it; infinite beyond the border."""
    moved = np.full_like(row, np.inf)
    if by > 0:
        moved[:, by:] = row[:, :-by]
    else:
        moved[:, :by] = row[:, -by:]
    return moved


def _shift(
    free: NDArray[np.bool_], last: int, row: int, side: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where a diagonal step, and a knight's, from row `last` to `row` cuts no corner.

    The four cells a knight's step touches are the same in both directions.
    """
    a, b = free[last], free[row]
    beside_a, beside_b = _beside(a, side), _beside(b, side)
    near = beside_a & a & beside_b & b
    return near, _beside(beside_a, side) & beside_a & beside_b & b


def _beside(row: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    moved = np.zeros_like(row)
    if side > 0:
        moved[1:] = row[:-1]
    else:
        moved[:-1] = row[1:]
    return moved


def _through_passages(space: FreeSpace, metres: NDArray[np.float32]) -> None:
    flat = metres.reshape(len(metres), -1)
    free = space.free.reshape(-1)
    for passage in space.passages:
        if not (free[passage.a] and free[passage.b]):
            continue
        length = np.float32(passage.metres / space.cell)
        both = np.minimum(flat[:, passage.a], flat[:, passage.b] + length)
        flat[:, passage.b] = np.minimum(flat[:, passage.b], flat[:, passage.a] + length)
        flat[:, passage.a] = both


def metres_between(space: FreeSpace, cells: ArrayLike) -> NDArray[np.float64]:
    """(n, n) [m] shortest ways between n cells; infinite where none leads."""
    at = np.asarray(cells, np.intp).reshape(-1)
    fields = distance_fields(space, at).reshape(len(at), -1)
    between = fields[:, at].astype(np.float64)
    return np.minimum(between, between.T)


def way(space: FreeSpace, field: NDArray[np.float32], start: int) -> NDArray[np.intp]:
    """Cells (n,) from `start` down the distance `field` (nx, ny) [m] to where it is zero.

    Raises LayoutError where no way leads.
    """
    flat = field.reshape(-1)
    if not np.isfinite(flat[start]):
        raise LayoutError("no way leads there over the floor that is known")
    cells = [start]
    while flat[cells[-1]] > 1e-6 and len(cells) <= flat.size:
        cells.append(_downhill(space, flat, cells[-1]))
    return np.array(cells, np.intp)


def _downhill(space: FreeSpace, flat: NDArray[np.float32], cell: int) -> int:
    """The neighbour, or the far end of a passage, through which the shortest way goes on."""
    best, least = cell, np.inf
    for there, metres in _neighbours(space, cell):
        total = float(flat[there]) + metres * space.cell
        if flat[there] < flat[cell] and total < least:
            best, least = there, total
    for passage in space.passages:
        for a, b in ((passage.a, passage.b), (passage.b, passage.a)):
            if cell == a and flat[b] < flat[a] and float(flat[b]) + passage.metres < least - 1e-6:
                best, least = b, float(flat[b]) + passage.metres
    if best == cell:
        raise LayoutError("the way ends before its goal")
    return best


def _neighbours(space: FreeSpace, cell: int) -> Iterator[tuple[int, float]]:
    """The floor cells one step from `cell` that no corner is cut to, and the step in cells."""
    nx, ny = space.shape
    ix, iy = divmod(cell, ny)
    for dx, dy in _STEPS:
        x, y = ix + dx, iy + dy
        if not (0 <= x < nx and 0 <= y < ny):
            continue
        if space.free[x, y] and space.free[x, iy] and space.free[ix, y]:
            yield x * ny + y, _DIAGONAL if dx and dy else 1.0
