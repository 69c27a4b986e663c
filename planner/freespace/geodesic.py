"""Geodesic distances and shortest paths over the floor, from many cells at once.

Distances are shortest path lengths on a graph with sixteen steps from each cell (a chess king's and
a knight's moves): at most 2.8 % above the shortest line, never below the straight one, and exactly
the same in both directions. Lengths are integers, a thousandth of a cell, diagonals rounded up, so
that sums are exact and the triangle inequality holds.

Floor that nobody saw counts threefold: it takes as long as expected if there may be no way.

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
    links = _links(space, np.array([(0, 0), space.shape]))
    steps = StepLengths.over(space.free, links, space.unseen)
    metres = np.empty((len(cells), space.room.size), np.float32)
    done = 0
    for lengths in path_lengths(steps, cells):
        _in_metres(lengths, space.cell, metres[done : done + len(lengths)])
        done += len(lengths)
    return metres.reshape(len(cells), *space.shape)


def _in_metres(
    lengths: NDArray[np.int32], cell: float, out: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Path lengths in metres, infinite where no way leads."""
    metres = np.empty(lengths.shape, np.float32) if out is None else out
    np.multiply(lengths, cell / UNIT, out=metres, casting="same_kind")
    metres[lengths >= FAR] = np.inf
    return metres


def _links(space: FreeSpace, box: NDArray[np.intp]) -> tuple[Link, ...]:
    """The passages within a box ((first cell), (end)) of the grid, by numbers of cells in it."""
    found, shape = list[Link](), box[1] - box[0]
    for passage in space.passages:
        a, b = (np.array(divmod(cell, space.shape[1])) - box[0] for cell in (passage.a, passage.b))
        if (np.minimum(a, b) >= 0).all() and (np.maximum(a, b) < shape).all():
            length = max(round(passage.metres / space.cell * UNIT), 1)
            found.append((int(a @ (shape[1], 1)), int(b @ (shape[1], 1)), length))
    return tuple(found)


LAST_STEPS: Final = 3  # cells before the end of a way by which the robot's heading is known
_BOX: Final = 60_000  # cells of a grid from which on ways stay within a box around their ends, ...
_AROUND: Final = 5.0  # ... and as many metres around it
_KEPT: Final = 32e6  # bytes of whole fields that are kept


class ShortestWays:
    """Shortest ways between the cells `ends` (n,) of a floor, and to them.

    Fields over the whole floor are computed as they are asked for. On a large floor, ways between
    `ends` that leave a box around them are left out, if all can be reached within it.
    """

    def __init__(self, space: FreeSpace, ends: NDArray[np.intp]) -> None:
        self._space, self.ends = space, ends
        self._fields: dict[int, NDArray[np.float32]] = {}
        self._headings: dict[int, NDArray[np.float64]] = {}
        self._number = {int(cell): number for number, cell in enumerate(ends)}
        self._near = _around(space, ends, LAST_STEPS)
        lengths = _between(space, ends, self._near)
        self._metres = _in_metres(lengths, space.cell)  # (cells near an end, n)
        between = self._metres[np.searchsorted(self._near, ends)].astype(np.float64)
        #: (n, n) [m] between ends
        self.metres: NDArray[np.float64] = np.minimum(between, between.T)

    def field(self, cell: int) -> NDArray[np.float32]:
        """(nx, ny) [m] the shortest way from each cell to `cell`."""
        if cell not in self._fields:
            made = distance_fields(self._space, [cell])[0]
            while self._fields and (len(self._fields) + 1) * made.nbytes > _KEPT:
                self._fields.pop(next(iter(self._fields)))
            self._fields[cell] = made
        return self._fields[cell]

    def metres_from(self, cell: int) -> NDArray[np.float64]:
        """(n,) [m] the shortest way from `cell` to each end."""
        number = self._number.get(cell)
        if number is not None:
            return np.asarray(self.metres[number], np.float64)
        return self.field(cell).reshape(-1)[self.ends].astype(np.float64)

    def arriving(self, cell: int) -> NDArray[np.float64]:
        """(n,) [rad] headings with which shortest ways from `cell` arrive at each end."""
        if cell not in self._headings:
            number, space = self._number.get(cell), self._space
            if number is None:
                field = self.field(cell)
            else:
                field = np.full(space.shape, np.inf, np.float32)
                field.reshape(-1)[self._near] = self._metres[:, number]
            way = space.centres(self.ends)
            way = way - space.centres(cells_before(space, field, self.ends, LAST_STEPS))
            self._headings[cell] = np.arctan2(way[:, 1], way[:, 0])
        return self._headings[cell]


def _around(space: FreeSpace, cells: NDArray[np.intp], steps: int) -> NDArray[np.intp]:
    """Cells at most `steps` rows and columns from any of `cells`, ascending."""
    nx, ny = space.shape
    off = np.arange(-steps, steps + 1)
    ix, iy = (at[:, None] + off for at in np.divmod(cells, ny))
    ix, iy = np.clip(ix, 0, nx - 1)[:, :, None], np.clip(iy, 0, ny - 1)[:, None, :]
    return np.unique(ix * ny + iy)


def _between(space: FreeSpace, ends: NDArray[np.intp], near: NDArray[np.intp]) -> NDArray[np.int32]:
    """(m, n) path lengths from each of `ends` (n,) to the cells `near` (m,)."""
    box = whole = np.array([(0, 0), space.shape])
    if space.room.size > _BOX and len(ends):
        at, margin = np.stack(np.divmod(ends, space.shape[1]), axis=1), _AROUND / space.cell
        around = np.array([at.min(axis=0) - margin, at.max(axis=0) + margin + 1], np.intp)
        box = np.clip(around, 0, space.shape)
    found = _within(space, box, ends, near)
    if (found[np.searchsorted(near, ends)] >= FAR).any() and (box != whole).any():
        return _within(space, whole, ends, near)
    return found


def _within(
    space: FreeSpace, box: NDArray[np.intp], ends: NDArray[np.intp], near: NDArray[np.intp]
) -> NDArray[np.int32]:
    """As `_between`, by ways within a box ((first cell), (end)) of the grid."""
    window = tuple(slice(*side) for side in box.T)
    there, source = (
        (np.stack(np.divmod(cells, space.shape[1]), axis=1) - box[0]) @ (box[1, 1] - box[0, 1], 1)
        for cells in (near, ends)
    )
    unseen = None if space.unseen is None else space.unseen[window]
    steps = StepLengths.over(space.free[window], _links(space, box), unseen)
    parts = [np.ascontiguousarray(part.T[there]) for part in path_lengths(steps, source)]
    return np.concatenate(parts, axis=1) if parts else np.zeros((len(near), 0), np.int32)


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
UNSEEN: Final = 3  # lengths that floor counts for which nobody saw
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
    along: NDArray[np.int32]  # (rows, columns, 1) length from the first cell of the row
    runs: tuple[tuple[tuple[int, int], ...], ...]  # by row: (from, to) of each passable stretch
    links: tuple[Link, ...] = ()

    @staticmethod
    def over(
        passable: NDArray[np.bool_],
        links: tuple[Link, ...] = (),
        unseen: NDArray[np.bool_] | None = None,
    ) -> StepLengths:
        """Lengths over `passable` (rows, columns); `links` of other cells are left out.

        Half of each step counts `UNSEEN` lengths if it is in a cell that is `unseen`.
        """
        slow = np.zeros(passable.shape, np.int32)  # further halves of lengths that a cell counts
        slow += 0 if unseen is None else (UNSEEN - 1) * unseen
        steps = tuple(
            (*step, _lengths(passable, step, (2 + slow + _moved(slow, step)) * length // 2, cells))
            for step, length, cells in _STEPS
        )
        along = np.cumsum((2 + slow + _moved(slow, (0, 1))) * UNIT // 2, axis=1, dtype=np.int32)
        flat = passable.reshape(-1)
        kept = tuple(link for link in links if flat[link[0]] and flat[link[1]])
        stretches: list[list[tuple[int, int]]] = [[] for _ in passable]
        for row, first, end in runs(passable).tolist():
            stretches[row].append((first, end))
        return StepLengths(passable, steps, along[:, :, None], tuple(map(tuple, stretches)), kept)


def _lengths(
    passable: NDArray[np.bool_],
    step: tuple[int, int],
    length: NDArray[np.int32],
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
            row, ramp = self._field[r, a:b], self._lengths.along[r, a:b]
            right = row - ramp
            np.minimum.accumulate(right, axis=0, out=right)
            right += ramp
            left = (row + ramp)[::-1]
            np.minimum.accumulate(left, axis=0, out=left)
            np.minimum(row, right, out=row)
            np.minimum(row, left[::-1] - ramp, out=row)
