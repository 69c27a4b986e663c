"""Shortest ways over a grid from many cells at once: sweeps of whole rows, all sources together.

A step goes to one of sixteen neighbours (a chess king's and a knight's moves), so a way is at most
2.8 % longer than the shortest line. Lengths are integers, a thousandth of a cell, diagonals rounded
up: the sums are exact, the triangle inequality holds, and no way is shorter than the straight line.

The sweep (rows down, rows up, along each row, until nothing changes) is that of Zhao's fast
sweeping method (Mathematics of Computation 74, 2005), on a graph in place of the eikonal equation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

UNIT: Final = 1000  # of length a cell
FAR: Final = 1 << 29  # not reachable; twice of it still fits an int32
_TOGETHER: Final = 128  # sources swept at once: a row of all of them stays in the cache

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

Link = tuple[int, int, int]  # two cells by number that a passage joins, and its length


@dataclass(frozen=True, slots=True, eq=False)
class StepCosts:
    """What each step over a grid costs, [thousandths of a cell]; the same both ways."""

    passable: NDArray[np.bool_]  # (rows, columns)
    toll: NDArray[np.int32]  # (rows, columns) extra on a cell, half on entering, half on leaving
    steps: tuple[tuple[int, int, NDArray[np.int32]], ...]  # rows, columns, (rows, columns) to here
    ramps: tuple[tuple[tuple[int, int, NDArray[np.int32]], ...], ...]  # by row: from, to, (n, 1)
    links: tuple[Link, ...] = ()

    @staticmethod
    def over(
        passable: NDArray[np.bool_], toll: NDArray[np.int32], links: tuple[Link, ...] = ()
    ) -> StepCosts:
        """Costs of the steps over `passable` (rows, columns); `links` to what is not are left out.

        A link's length has the tolls of neither of its ends.
        """
        steps = tuple(
            (*step, _cost(passable, toll, step, length, between))
            for step, length, between in _STEPS
        )
        ramps = tuple(
            tuple((a, b, _ramp(toll[r, a:b])) for a, b in runs(row))
            for r, row in enumerate(passable)
        )
        flat = passable.reshape(-1)
        links = tuple(link for link in links if flat[link[0]] and flat[link[1]])
        return StepCosts(passable, toll, steps, ramps, links)

    def neighbours(self, cell: int) -> list[tuple[int, int]]:
        """(cell, cost) of every step away from `cell`, by number."""
        rows, columns = self.passable.shape
        r, c = divmod(cell, columns)
        out = [(b if cell == a else a, cost) for a, b, cost in self.links if cell in (a, b)]
        for side in (-1, 1):
            if 0 <= c + side < columns and self.passable[r, c + side] and self.passable[r, c]:
                tolls = int(self.toll[r, c]) + int(self.toll[r, c + side])
                out.append((cell + side, UNIT + tolls // 2))
        for i, j, cost in self.steps:
            for y, x, at in ((r - i, c - j, (r, c)), (r + i, c + j, (r + i, c + j))):
                if 0 <= y < rows and 0 <= x < columns and cost[at] < FAR:
                    out.append((y * columns + x, int(cost[at])))
        return out


def runs(row: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """(from, to) of each stretch of True in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    for a, b in edges.reshape(-1, 2):
        yield int(a), int(b)


def _ramp(toll: NDArray[np.int32]) -> NDArray[np.int32]:
    between = UNIT + (toll[1:] + toll[:-1]) // 2
    return np.concatenate([[0], np.cumsum(between)]).astype(np.int32)[:, None]


def _cost(
    passable: NDArray[np.bool_],
    toll: NDArray[np.int32],
    step: tuple[int, int],
    length: int,
    between: tuple[tuple[int, int], ...],
) -> NDArray[np.int32]:
    clear = passable & _moved(passable, step)
    tolls = (toll + _moved(toll, step)) // 2
    for i, j in between:
        back = (step[0] - i, step[1] - j)
        clear &= _moved(passable, back)
        tolls += _moved(toll, back) // len(between)  # no step leaps over a toll
    return np.where(clear, length + tolls, FAR).astype(np.int32)


def _moved(values: NDArray[_T], step: tuple[int, int]) -> NDArray[_T]:
    """`values` at (row - step[0], column - step[1]) of each cell, 0 outside."""
    i, j = step
    rows, columns = values.shape
    out = np.zeros_like(values)
    into, of = _columns(columns, j)
    out[i:, into] = values[: max(rows - i, 0), of]
    return out


def _columns(columns: int, j: int) -> tuple[slice, slice]:
    """Columns a step by `j` arrives in, and those it leaves from."""
    if j >= 0:
        return slice(j, columns), slice(0, max(columns - j, 0))
    return slice(0, max(columns + j, 0)), slice(-j, columns)


def swept(costs: StepCosts, sources: NDArray[np.intp]) -> Iterator[NDArray[np.int32]]:
    """Cost of the cheapest way to every cell, (k, rows * columns) for some sources after others.

    FAR where no way leads. `sources` (n,) are numbers of cells; one that is not passable reaches
    nothing.
    """
    for first in range(0, len(sources), _TOGETHER):
        yield _fields(costs, sources[first : first + _TOGETHER]).T


def _fields(costs: StepCosts, sources: NDArray[np.intp]) -> NDArray[np.int32]:
    """(rows * columns, k)."""
    rows, columns = costs.passable.shape
    field = np.full((rows, columns, len(sources)), FAR, np.int32)
    flat = field.reshape(rows * columns, len(sources))
    starts = costs.passable.reshape(-1)[sources]
    flat[sources[starts], np.flatnonzero(starts)] = 0
    _Sweep(costs, field, flat).run()
    return flat


class _Sweep:
    """Relaxes `field` (rows, columns, sources) in place until nothing changes."""

    def __init__(self, costs: StepCosts, field: NDArray[np.int32], flat: NDArray[np.int32]) -> None:
        self._costs, self._field, self._flat = costs, field, flat
        self._best = np.empty(field.shape[1:], np.int32)
        self._way = np.empty(field.shape[1:], np.int32)
        self._changed = np.zeros(len(field), np.int64)  # tick of a row's last change
        self._relaxed = {1: np.zeros(len(field), np.int64), -1: np.zeros(len(field), np.int64)}
        self._tick = 1

    def run(self) -> None:
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
        for a, b, cost in self._costs.links:
            for here, there in ((a, b), (b, a)):
                way = self._flat[here] + cost
                if (way < self._flat[there]).any():
                    np.minimum(self._flat[there], way, out=self._flat[there])
                    self._along(there // columns)

    def _from(self, r: int, way: int) -> None:
        """Relax row `r` from the two rows before it on a sweep in direction `way`."""
        before = [r - way * i for i in (1, 2) if 0 <= r - way * i < len(self._field)]
        if not before or self._changed[before].max() <= self._relaxed[way][r]:
            return
        self._relaxed[way][r] = self._tick
        self._best.fill(FAR)
        for i, j, cost in self._costs.steps:
            at = r - way * i
            if 0 <= at < len(self._field):
                self._step(at, r, j, cost, way)
        if (self._best < self._field[r]).any():
            np.minimum(self._field[r], self._best, out=self._field[r])
            self._along(r)

    def _step(self, at: int, r: int, j: int, cost: NDArray[np.int32], way: int) -> None:
        later, earlier = _columns(self._field.shape[1], j)
        into, of = (later, earlier) if way > 0 else (earlier, later)
        price = cost[max(at, r), later]
        out = self._way[: len(price)]
        np.add(self._field[at, of], price[:, None], out=out)
        np.minimum(self._best[into], out, out=self._best[into])

    def _along(self, r: int) -> None:
        """Relax row `r` to the right and to the left, within each of its open stretches."""
        self._tick += 1
        self._changed[r] = self._tick
        for a, b, ramp in self._costs.ramps[r]:
            row = self._field[r, a:b]
            right = row - ramp
            np.minimum.accumulate(right, axis=0, out=right)
            right += ramp
            left = (row + ramp)[::-1]
            np.minimum.accumulate(left, axis=0, out=left)
            np.minimum(row, right, out=row)
            np.minimum(row, left[::-1] - ramp, out=row)
