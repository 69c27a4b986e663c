"""The walks of `walks`, compiled: what they cost depends on when they arrive.

As there, a walk pays a[j] x phi(arrival) at each place and earns its price, and values in rows of
time bound all times between them, as they are concave. Free steps (`memories`) of 2, 4, 8, ... rows
or more are worked out every so many rows and drawn as a line between these, which bounds them for
the same reason. Memory lasts over steps of any length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.ordering.compiled import compiled
from planner.ordering.kernel import Kernel
from planner.ordering.memories import Array, Memories, States, Whole
from planner.ordering.tangent import Tangent

#: how much longer than a known order a walk may take before it is only bounded
_HORIZON = 1.15
#: most rings of free steps: the last is worked out every 2^7 rows
_RINGS = 8
#: walks that are drawn to say how often places are visited
_RUNS = 8
#: [s] a free step and a bound one take, to tell how long a table does
_FREE, _BOUND = 3.5e-9, 3e-9
#: most numbers in a table of values
_MOST = 40_000_000


class _Steps(NamedTuple):
    """All steps of all places: of each, its bound ones first, then ring after ring."""

    pointer: Whole  # (m + 1,)
    ring: Whole  # (m, rings + 1) where each ring of a place begins
    to: Whole
    rows: Whole  # whole rows a step takes
    part: Array  # and which part of a row
    map: Whole  # where in `after` its states begin; -1 of a free one


class TimedWalks:
    """Walks on the time grid of a kernel and a known order."""

    def __init__(self, kernel: Kernel, known: Tangent, memories: Memories) -> None:
        m = kernel.size
        self.known, self.memories = known, memories
        self.step = shortest(kernel) * (1 - 1e-9)
        self.rows = int(known.total * _HORIZON / self.step) + 1
        self.phi: Array = known.phi(np.arange(self.rows + 1) * self.step)
        legs = kernel.D[:m].astype(np.float64) / self.step
        self._steps = _steps(legs, memories)
        start = kernel.D[m].astype(np.float64) / self.step
        self._first_rows = start.astype(np.int64)
        self._first_part: Array = start - self._first_rows
        self._arrive = np.empty((self.rows + 1, memories.states))
        self._bare = np.empty((m, self.rows + 2))

    def bound(self, price: Array) -> float:
        """The bound at `price` (m,)."""
        known, memories, steps = self.known, self.memories, self._steps
        # beyond the grid a walk is given all that it could still earn
        late = -float(np.maximum(price - known.a * self.phi[self.rows], 0.0).sum())
        _backward(
            steps.pointer, steps.ring, steps.to, steps.rows, steps.part, steps.map,
            memories.after, memories.first, self.phi, known.a, price, late,
            self._arrive, self._bare,
        )  # fmt: skip
        place = np.arange(len(price))
        row = np.minimum(self._first_rows, self.rows)
        low, high = self._bare[place, row], self._bare[place, row + 1]
        start = float((low + (high - low) * self._first_part).min())
        return known.base + float(price.sum()) + min(start, 0.0)

    def visits(self, draw: int) -> Array:
        """(m,) visits of a few walks that take either row about a time, drawn by its part.

        This steers the prices alone; a bound holds whatever they are.
        """
        steps, memories = self._steps, self.memories
        visits = np.zeros(len(self.known.a))
        _draw(
            steps.pointer, steps.to, steps.rows, steps.part, steps.map, memories.after,
            memories.first, self._first_rows, self._first_part, self._arrive, _RUNS, draw, visits,
        )  # fmt: skip
        return visits


def shortest(kernel: Kernel) -> float:
    """Seconds of the shortest leg."""
    return float(kernel.D[~np.eye(kernel.size + 1, kernel.size, dtype=bool)].min())


def seconds_a_table(kernel: Kernel, known: Tangent, memory: int) -> float:
    """[s] a table of values takes, about; infinity where it would be too large."""
    step, m = shortest(kernel), kernel.size
    rows = known.total * _HORIZON / step if step > 0 else np.inf
    if not rows * (m << memory) < _MOST:
        return np.inf
    rings = np.exp2(np.clip(np.floor(np.log2(kernel.D[:m] / step + 1e-9)), 0, _RINGS - 1))
    free = float((1.0 / rings).sum())
    return rows * (free * _FREE + (m << memory) * (memory + 2) * _BOUND)


def _steps(legs: Array, memories: Memories) -> _Steps:
    m = len(legs)
    ring = np.zeros((m, m), dtype=np.int64)
    for k in range(1, _RINGS):
        ring += legs >= 1 << k
    ring = np.where(memories.free, ring, -1)
    np.fill_diagonal(ring, _RINGS)
    order = np.argsort(ring, axis=1, kind="stable")[:, :-1]
    begins = [(ring < k).sum(axis=1) for k in range(_RINGS + 1)]
    base = np.arange(m + 1, dtype=np.int64) * (m - 1)
    to = order.ravel().astype(np.int64)
    length = np.take_along_axis(legs, order, axis=1).ravel()
    rows = length.astype(np.int64)
    maps = np.full((m, m), -1, dtype=np.int64)
    place = np.repeat(np.arange(m), np.diff(memories.bound))
    maps[place, memories.to] = memories.map
    chosen = np.take_along_axis(maps, order, axis=1).ravel()
    pointers = (np.stack(begins, axis=1) + base[:-1, None]).astype(np.int64)
    return _Steps(base, pointers, to, rows, length - rows, chosen)


@compiled(
    "void(i8[::1],i8[:,::1],i8[::1],i8[::1],f8[::1],i8[::1],i4[::1],i8[::1],"
    "f8[::1],f8[::1],f8[::1],f8,f8[:,::1],f8[:,::1])"
)
def _backward(  # noqa: C901 - one kernel: a call inside costs more than the loop
    pointer: Whole,
    ring: Whole,
    to: Whole,
    rows: Whole,
    part: Array,
    maps: Whole,
    after: States,
    first: Whole,
    phi: Array,
    a: Array,
    price: Array,
    late: float,
    arrive: Array,
    bare: Array,
) -> None:
    """Fill `arrive` (rows + 1, states), and `bare` (m, rows + 2) for states without memory.

    Both hold what is still paid and earned from an arrival on, its own part included.
    """
    last, m, rings = arrive.shape[0] - 1, len(a), ring.shape[1] - 1
    arrive[last] = late
    bare[:, last:] = late
    far = np.full((rings, m, 2), late)
    best = np.empty(int(np.diff(first).max()))
    for r in range(last - 1, -1, -1):
        for c in range(rings):
            block = 1 << c
            if r % block != block - 1 and r != last - 1:
                continue
            low = r - r % block
            for i in range(m):
                least = 1e30
                for e in range(ring[i, c], ring[i, c + 1]):
                    t = min(low + rows[e], last)
                    value = bare[to[e], t]
                    value += (bare[to[e], t + 1] - value) * part[e]
                    least = min(least, value)
                far[c, i, 1] = far[c, i, 0]
                far[c, i, 0] = least
        for i in range(m):
            onward = 0.0
            for c in range(rings):
                value = far[c, i, 0]
                value += (far[c, i, 1] - value) * (r % (1 << c)) / (1 << c)
                onward = min(onward, value)
            begin = first[i]
            count = first[i + 1] - begin
            best[:count] = onward
            for e in range(pointer[i], ring[i, 0]):
                t = min(r + rows[e], last)
                late_row = min(t + 1, last)
                for s in range(count):
                    state = after[maps[e] + s]
                    if state >= 0:
                        value = arrive[t, state]
                        value += (arrive[late_row, state] - value) * part[e]
                        best[s] = min(best[s], value)
            pays = a[i] * phi[r] - price[i]
            for s in range(count):
                arrive[r, begin + s] = best[s] + pays
            bare[i, r] = arrive[r, begin]


@compiled(
    "void(i8[::1],i8[::1],i8[::1],f8[::1],i8[::1],i4[::1],i8[::1],i8[::1],f8[::1],"
    "f8[:,::1],i8,i8,f8[::1])"
)
def _draw(
    pointer: Whole,
    to: Whole,
    rows: Whole,
    part: Array,
    maps: Whole,
    after: States,
    first: Whole,
    first_rows: Whole,
    first_part: Array,
    arrive: Array,
    runs: int,
    draw: int,
    visits: Array,
) -> None:
    """Add up the visits (m,) of `runs` cheapest walks, each a share of one."""
    last, m = arrive.shape[0] - 1, len(visits)
    np.random.seed(draw)
    for _ in range(runs):
        least, i, r, s = 0.0, -1, np.int64(0), np.int64(0)
        for j in range(m):
            t = min(first_rows[j], last)
            value = arrive[t, first[j]]
            value += (arrive[min(t + 1, last), first[j]] - value) * first_part[j]
            if value < least:
                least, i = value, j
        if i >= 0:
            r = first_rows[i] + (1 if np.random.random() < first_part[i] else 0)
        while i >= 0 and r < last:
            visits[i] += 1.0 / runs
            least, best, best_state = 0.0, -1, np.int64(0)
            for e in range(pointer[i], pointer[i + 1]):
                state = np.int64(after[maps[e] + s]) if maps[e] >= 0 else first[to[e]]
                if state < 0:
                    continue
                t = min(r + rows[e], last)
                value = arrive[t, state]
                value += (arrive[min(t + 1, last), state] - value) * part[e]
                if value < least:
                    least, best, best_state = value, e, state
            if best < 0:
                break
            r += rows[best] + (1 if np.random.random() < part[best] else 0)
            i = to[best]
            s = best_state - first[i]
