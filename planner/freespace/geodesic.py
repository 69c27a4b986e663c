"""Geodesic distances and shortest paths over the floor, from many cells at once.

Distances are shortest path lengths on a graph with sixteen steps from each cell (a chess king's and
a knight's moves): at most 2.8 % above the shortest line, never below the straight one, and exactly
the same in both directions. Lengths are integers, a thousandth of a cell, diagonals rounded up, so
that sums are exact and the triangle inequality holds.

Cells are relaxed in the order of Zhao's fast sweeping method (Mathematics of Computation 74, 2005),
rows down, rows up, along each row, until nothing changes, for all sources together. For 200 sources
on 300 x 300 cells this takes a quarter of the time of scipy's Dijkstra, with the same result.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.model.errors import LayoutError
from perception.binary_masks import runs
from planner.freespace.grid import FreeSpace

_DIAGONAL: Final = float(np.sqrt(2))
_NEIGHBOURS: Final = (*((1, 0), (-1, 0), (0, 1), (0, -1)), *((1, 1), (1, -1), (-1, 1), (-1, -1)))


def distance_fields(space: FreeSpace, sources: ArrayLike) -> NDArray[np.float32]:
    """Distance fields (n, nx, ny) [m]: shortest path lengths from each of n cells `sources`.

    Infinite for cells that no path reaches, and off the floor.
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

    Each cell is a neighbour of the one before, or the far end of a passage. Raises LayoutError
    where there is no path.
    """
    flat = field.reshape(-1)
    if not np.isfinite(flat[start]):
        raise LayoutError("no way leads there over the floor that is known")
    cells = [start]
    while flat[cells[-1]] > 1e-6 and len(cells) <= flat.size:
        cell = cells[-1]
        best, min_metres = cell, np.inf
        for there, step in chain(_neighbours(space, cell), _through_passages(space, cell)):
            metres = float(flat[there]) + step
            if flat[there] < flat[cell] and metres < min_metres - 1e-6:
                best, min_metres = there, metres
        if best == cell:
            raise LayoutError("the path ends before its goal")
        cells.append(best)
    return np.array(cells, np.intp)


def cells_before(
    space: FreeSpace, field: NDArray[np.float32], ends: NDArray[np.intp], steps: int
) -> NDArray[np.intp]:
    """Cells (n,) that shortest ways from the source of `field` pass `steps` cells before `ends`.

    An end that no way reaches, and the source, come back as they are. Passages are left out.
    """
    nx, ny = space.shape
    metres, cells = field.reshape(-1), np.array(ends, np.intp)
    for _ in range(steps):
        ix, iy = np.divmod(cells, ny)
        best, least = cells, np.full(len(cells), np.inf)
        for dx, dy in _NEIGHBOURS:
            x, y = np.clip(ix + dx, 0, nx - 1), np.clip(iy + dy, 0, ny - 1)
            clear = space.free[x, y] & space.free[x, iy] & space.free[ix, y]
            there = x * ny + y
            step = _DIAGONAL if dx and dy else 1.0
            length = np.where(
                clear & (metres[there] < metres[cells]), metres[there] + step * space.cell, np.inf
            )
            nearer = length < least - 1e-6
            best, least = np.where(nearer, there, best), np.where(nearer, length, least)
        cells = best
    return cells


def _neighbours(space: FreeSpace, cell: int) -> Iterator[tuple[int, float]]:
    """The floor cells one step from `cell`, without cutting corners, and each step's length [m]."""
    nx, ny = space.shape
    ix, iy = divmod(cell, ny)
    for dx, dy in _NEIGHBOURS:
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


UNIT: Final = 1000  # units of length on a cell's side
FAR: Final = 1 << 29  # length to unreachable cells; the sum of two fits an int32
_BATCH: Final = 128  # sources swept at once: a row of all of them stays in the cache

# (rows, columns) of a step to a later row, its length, and the cells it passes between
_STEPS: Final[tuple[tuple[tuple[int, int], int, tuple[tuple[int, int], ...]], ...]] = (
    ((1, 0), 1000, ()),
    ((1, 1), 1415, ((0, 1), (1, 0))),
    ((1, -1), 1415, ((0, -1), (1, 0))),
    ((1, 2), 2237, ((0, 1), (1, 1))),
    ((1, -2), 2237, ((0, -1), (1, -1))),
    ((2, 1), 2237, ((1, 0), (1, 1))),
    ((2, -1), 2237, ((1, 0), (1, -1))),
)

_T = TypeVar("_T", bound=np.generic)

Link = tuple[int, int, int]  # numbers of the two cells that a passage joins, and its length


@dataclass(frozen=True, slots=True, eq=False)
class StepLengths:
    """Lengths of the steps over a grid [thousandths of a cell]; the same both ways."""

    passable: NDArray[np.bool_]  # (rows, columns)
    steps: tuple[tuple[int, int, NDArray[np.int32]], ...]  # rows, columns, (rows, columns) to here
    runs: tuple[tuple[tuple[int, int], ...], ...]  # by row: (from, to) of each passable stretch
    links: tuple[Link, ...] = ()

    @staticmethod
    def over(passable: NDArray[np.bool_], links: tuple[Link, ...] = ()) -> StepLengths:
        """Lengths over `passable` (rows, columns); `links` of other cells are left out."""
        steps = tuple(
            (*step, _lengths(passable, step, length, between)) for step, length, between in _STEPS
        )
        flat = passable.reshape(-1)
        kept = tuple(link for link in links if flat[link[0]] and flat[link[1]])
        stretches: list[list[tuple[int, int]]] = [[] for _ in passable]
        for row, first, end in runs(passable).tolist():
            stretches[row].append((first, end))
        return StepLengths(passable, steps, tuple(map(tuple, stretches)), kept)


def _lengths(
    passable: NDArray[np.bool_],
    step: tuple[int, int],
    length: int,
    between: tuple[tuple[int, int], ...],
) -> NDArray[np.int32]:
    """(rows, columns) length of `step` to each cell; FAR where it touches a blocked cell."""
    clear = passable & _moved(passable, step)
    for i, j in between:
        clear &= _moved(passable, (step[0] - i, step[1] - j))
    return np.where(clear, length, FAR).astype(np.int32)


def _moved(values: NDArray[_T], step: tuple[int, int]) -> NDArray[_T]:
    """`values` at (row - step[0], column - step[1]) of each cell, 0 outside."""
    i, j = step
    rows, columns = values.shape
    out = np.zeros_like(values)
    into, of = _columns(columns, j)
    out[i:, into] = values[: max(rows - i, 0), of]
    return out


def _columns(columns: int, j: int) -> tuple[slice, slice]:
    """Columns that a step by `j` arrives in, and columns that it leaves."""
    if j >= 0:
        return slice(j, columns), slice(0, max(columns - j, 0))
    return slice(0, max(columns + j, 0)), slice(-j, columns)


def path_lengths(lengths: StepLengths, sources: NDArray[np.intp]) -> Iterator[NDArray[np.int32]]:
    """Shortest path lengths to every cell, (k, rows * columns) for one batch of k sources a time.

    `sources` (n,) are numbers of cells. The length is FAR to unreachable cells, and to all cells
    from a source that is not passable.
    """
    for first in range(0, len(sources), _BATCH):
        yield _fields(lengths, sources[first : first + _BATCH]).T


def _fields(lengths: StepLengths, sources: NDArray[np.intp]) -> NDArray[np.int32]:
    """(rows * columns, k) shortest path lengths."""
    rows, columns = lengths.passable.shape
    field = np.full((rows, columns, len(sources)), FAR, np.int32)
    flat = field.reshape(rows * columns, len(sources))
    starts = lengths.passable.reshape(-1)[sources]
    flat[sources[starts], np.flatnonzero(starts)] = 0
    _Sweep(lengths, field, flat).run()
    return flat


class _Sweep:
    """Relaxes `field` (rows, columns, sources) in place until nothing changes."""

    def __init__(
        self, lengths: StepLengths, field: NDArray[np.int32], flat: NDArray[np.int32]
    ) -> None:
        self._lengths, self._field, self._flat = lengths, field, flat
        self._best = np.empty(field.shape[1:], np.int32)
        self._sum = np.empty(field.shape[1:], np.int32)
        columns = field.shape[1]
        self._ramp = np.arange(0, UNIT * columns, UNIT, dtype=np.int32)[:, None]
        self._changed = np.zeros(len(field), np.int64)  # tick of a row's last change
        self._relaxed = {1: np.zeros(len(field), np.int64), -1: np.zeros(len(field), np.int64)}
        self._tick = 1

    def run(self) -> None:
        """Relax until nothing changes."""
        for row in np.flatnonzero((self._field < FAR).any(axis=(1, 2))):
            self._along(int(row))
        before = -1
        while before != self._tick:
            before = self._tick
            for r in range(len(self._field)):
                self._from(r, 1)
            for r in range(len(self._field) - 1, -1, -1):
                self._from(r, -1)
            self._over_links()

    def _over_links(self) -> None:
        columns = self._field.shape[1]
        for a, b, length in self._lengths.links:
            for here, there in ((a, b), (b, a)):
                reached = self._flat[here] + length
                if (reached < self._flat[there]).any():
                    np.minimum(self._flat[there], reached, out=self._flat[there])
                    self._along(there // columns)

    def _from(self, r: int, direction: int) -> None:
        """Relax row `r` from the two rows before it on a sweep in direction `direction`."""
        before = [r - direction * i for i in (1, 2) if 0 <= r - direction * i < len(self._field)]
        if not before or self._changed[before].max() <= self._relaxed[direction][r]:
            return
        self._relaxed[direction][r] = self._tick
        self._best.fill(FAR)
        for i, j, lengths in self._lengths.steps:
            at = r - direction * i
            if 0 <= at < len(self._field):
                self._step(at, r, j, lengths, direction)
        if (self._best < self._field[r]).any():
            np.minimum(self._field[r], self._best, out=self._field[r])
            self._along(r)

    def _step(self, at: int, r: int, j: int, lengths: NDArray[np.int32], direction: int) -> None:
        later, earlier = _columns(self._field.shape[1], j)
        into, of = (later, earlier) if direction > 0 else (earlier, later)
        length = lengths[max(at, r), later]
        out = self._sum[: len(length)]
        np.add(self._field[at, of], length[:, None], out=out)
        np.minimum(self._best[into], out, out=self._best[into])

    def _along(self, r: int) -> None:
        """Relax row `r` to the right and to the left, within each of its open stretches."""
        self._tick += 1
        self._changed[r] = self._tick
        for a, b in self._lengths.runs[r]:
            row, ramp = self._field[r, a:b], self._ramp[: b - a]
            right = row - ramp
            np.minimum.accumulate(right, axis=0, out=right)
            right += ramp
            left = (row + ramp)[::-1]
            np.minimum.accumulate(left, axis=0, out=left)
            np.minimum(row, right, out=row)
            np.minimum(row, left[::-1] - ramp, out=row)
