"""Geodesic distances and shortest paths over the floor, from many cells at once.

Distances are those of the grid's 16 directions: at most 2.8 % above the shortest line, never below
the straight one, and exactly the same in both directions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.errors import LayoutError
from planner.freespace.fast_sweeping import FAR, UNIT, StepLengths, path_lengths
from planner.freespace.grid import FreeSpace

_DIAGONAL: Final = float(np.sqrt(2))
_STEPS: Final = (*((1, 0), (-1, 0), (0, 1), (0, -1)), *((1, 1), (1, -1), (-1, 1), (-1, -1)))


def distance_fields(space: FreeSpace, sources: ArrayLike) -> NDArray[np.float32]:
    """Distance fields (n, nx, ny) [m]: the shortest path from each of n cells `sources` to all.

    Infinite where no path leads, and on what is no floor.
    """
    cells = np.asarray(sources, np.intp).reshape(-1)
    links = tuple(
        (passage.a, passage.b, max(round(passage.metres / space.cell * UNIT), 1))
        for passage in space.passages
    )
    metres = np.empty((len(cells), space.room.size), np.float32)
    done = 0
    for lengths in path_lengths(StepLengths.over(space.free, links), cells):
        part = metres[done : done + len(lengths)]
        np.multiply(lengths, space.cell / UNIT, out=part, casting="same_kind")
        part[lengths >= FAR] = np.inf
        done += len(lengths)
    return metres.reshape(len(cells), *space.shape)


def shortest_path(space: FreeSpace, field: NDArray[np.float32], start: int) -> NDArray[np.intp]:
    """Shortest path: cells (n,) from `start` down the distance `field` (nx, ny) [m] to its source.

    Each is a neighbour of the one before or the far end of a passage. Raises LayoutError where no
    path leads.
    """
    flat = field.reshape(-1)
    if not np.isfinite(flat[start]):
        raise LayoutError("no way leads there over the floor that is known")
    cells = [start]
    while flat[cells[-1]] > 1e-6 and len(cells) <= flat.size:
        cell = cells[-1]
        steps = chain(_neighbours(space, cell), _through_passages(space, cell))
        cells.append(_downhill(flat, cell, steps))
    return np.array(cells, np.intp)


def _downhill(flat: NDArray[np.float32], cell: int, steps: Iterable[tuple[int, float]]) -> int:
    """Next cell of the shortest path from `cell`."""
    best, least = cell, np.inf
    for there, metres in steps:
        total = float(flat[there]) + metres
        if flat[there] < flat[cell] and total < least - 1e-6:
            best, least = there, total
    if best == cell:
        raise LayoutError("the path ends before its goal")
    return best


def _neighbours(space: FreeSpace, cell: int) -> Iterator[tuple[int, float]]:
    """The floor cells one step from `cell` that no corner is cut to, and the step [m]."""
    nx, ny = space.shape
    ix, iy = divmod(cell, ny)
    for dx, dy in _STEPS:
        x, y = ix + dx, iy + dy
        if not (0 <= x < nx and 0 <= y < ny):
            continue
        if space.free[x, y] and space.free[x, iy] and space.free[ix, y]:
            yield x * ny + y, (_DIAGONAL if dx and dy else 1.0) * space.cell


def _through_passages(space: FreeSpace, cell: int) -> Iterator[tuple[int, float]]:
    for passage in space.passages:
        for a, b in ((passage.a, passage.b), (passage.b, passage.a)):
            if cell == a:
                yield b, passage.metres
