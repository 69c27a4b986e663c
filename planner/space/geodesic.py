"""How far it is by foot: shortest ways over the floor, from many cells at once.

Distances are those of the grid's 16 directions: at most 2.8 % above the shortest line, never below
the straight one, and exactly the same in both directions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.errors import LayoutError
from planner.space.grid import FreeSpace
from planner.space.sweep import FAR, UNIT, StepCosts, swept

_DIAGONAL: Final = float(np.sqrt(2))
_STEPS: Final = (*((1, 0), (-1, 0), (0, 1), (0, -1)), *((1, 1), (1, -1), (-1, 1), (-1, -1)))
_MOST_TOLL: Final = 1000.0  # [m] a dearer way is as good as none


def distance_fields(
    space: FreeSpace, sources: ArrayLike, toll: ArrayLike | None = None
) -> NDArray[np.float32]:
    """(n, nx, ny) [m] the shortest way from each of the n cells `sources` to every cell.

    Infinite where no way leads, and on what is no floor. `toll` (nx, ny) [m] is what it costs more
    to pass each cell, half on entering it and half on leaving, such as the detour a door that may
    be closed is expected to bring. Raises LayoutError for tolls that are not such numbers.
    """
    cells = np.asarray(sources, np.intp).reshape(-1)
    costs = _costs(space, toll)
    metres = np.empty((len(cells), space.room.size), np.float32)
    done = 0
    for lengths in swept(costs, cells):
        part = metres[done : done + len(lengths)]
        np.multiply(lengths, space.cell / UNIT, out=part, casting="same_kind")
        part[lengths >= FAR] = np.inf
        done += len(lengths)
    return metres.reshape(len(cells), *space.shape)


def _costs(space: FreeSpace, toll: ArrayLike | None) -> StepCosts:
    extra = np.zeros(space.shape, np.int32)
    if toll is not None:
        extra[:] = np.rint(_checked(space, toll) / space.cell * UNIT)
    links = tuple(
        (passage.a, passage.b, max(round(passage.metres / space.cell * UNIT), 1))
        for passage in space.passages
    )
    return StepCosts.over(space.free, extra, links)


def _checked(space: FreeSpace, toll: ArrayLike) -> NDArray[np.float64]:
    metres = np.asarray(toll, np.float64)
    if metres.shape != space.shape or not ((metres >= 0) & (metres <= _MOST_TOLL)).all():
        raise LayoutError(
            f"tolls must be metres from 0 to {_MOST_TOLL:g}, one for each of the {space.shape} "
            f"cells, got shape {metres.shape}"
        )
    return metres


def metres_between(space: FreeSpace, cells: ArrayLike) -> NDArray[np.float64]:
    """(n, n) [m] shortest ways between n cells; infinite where none leads."""
    at = np.asarray(cells, np.intp).reshape(-1)
    fields = distance_fields(space, at).reshape(len(at), -1)
    return fields[:, at].astype(np.float64)


def way(
    space: FreeSpace, field: NDArray[np.float32], start: int, toll: ArrayLike | None = None
) -> NDArray[np.intp]:
    """Cells (n,) from `start` down the distance `field` (nx, ny) [m] to where it is zero.

    Each is a neighbour of the one before or the far end of a passage; with the `toll` that the
    field was made with, a knight's move may lie between. Raises LayoutError where no way leads.
    """
    flat = field.reshape(-1)
    if not np.isfinite(flat[start]):
        raise LayoutError("no way leads there over the floor that is known")
    steps = _steps_of(space, toll)
    cells = [start]
    while flat[cells[-1]] > 1e-6 and len(cells) <= flat.size:
        cells.append(_downhill(flat, cells[-1], steps(cells[-1])))
    return np.array(cells, np.intp)


_Steps = Callable[[int], Iterable[tuple[int, float]]]  # of a cell: where steps lead, and metres


def _steps_of(space: FreeSpace, toll: ArrayLike | None) -> _Steps:
    if toll is None:
        return lambda cell: chain(_neighbours(space, cell), _through_passages(space, cell))
    costs = _costs(space, toll)
    metres = space.cell / UNIT
    return lambda cell: ((there, cost * metres) for there, cost in costs.neighbours(cell))


def _downhill(flat: NDArray[np.float32], cell: int, steps: Iterable[tuple[int, float]]) -> int:
    """Where the shortest way goes on from `cell`."""
    best, least = cell, np.inf
    for there, metres in steps:
        total = float(flat[there]) + metres
        if flat[there] < flat[cell] and total < least - 1e-6:
            best, least = there, total
    if best == cell:
        raise LayoutError("the way ends before its goal")
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
