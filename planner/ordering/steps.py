"""The steps a walk with a short memory can take: from which state to which, and how long.

A state is a place and which of a few nearby places the walk has come through just before (the
ng-routes of Baldacci, Mingozzi and Roberti 2011): these it may not visit again yet. Legs to the
nearest places keep the memory; longer ones forget it, and depend on the place alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Ints, Kernel

Array = NDArray[np.float64]
#: cost of a step that must not be taken
NEVER = 1e30
#: rows that far steps of so many rows or more are worked out for at once
_BLOCKS = (1, 2, 4, 8, 16)


@dataclass(frozen=True, slots=True, eq=False)
class Leap:
    """Steps (k, n) from n states or places, in rows of the time grid."""

    index: Ints  # row offset x states + state reached: where to look the value up
    rows: Ints  # whole rows it takes
    part: Array  # and which part of a row
    barred: Array  # 0, or NEVER
    place: Ints  # the place it leads to
    state: Ints  # the state it leads to

    def __getitem__(self, columns: Ints) -> Leap:
        """The steps from some states alone."""
        return Leap(
            self.index[:, columns], self.rows[:, columns], self.part[:, columns],
            self.barred[:, columns], self.place[:, columns], self.state[:, columns],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Ring:
    """Far steps of like length, worked out every `block` rows, which none is shorter than."""

    leap: Leap  # n = m: from each place
    block: int


class Steps:
    """All steps of a kernel; q memories for each of m places, state = place x q + memory."""

    def __init__(self, kernel: Kernel, seconds: float, memory: int, nearest: int) -> None:
        m = kernel.size
        legs = kernel.D[:m].astype(np.float64)
        np.fill_diagonal(legs, np.inf)
        near = np.argsort(legs, axis=1, kind="stable")[:, : min(nearest, m - 1)]
        both = np.take_along_axis(legs + legs.T, near, axis=1)
        closest = np.argsort(both, axis=1, kind="stable")[:, :memory]
        #: (m, memory) the places that each place remembers
        self.remembered = np.take_along_axis(near, closest, axis=1)
        self.memories = 1 << self.remembered.shape[1]
        self.states = m * self.memories
        self.place = np.repeat(np.arange(m), self.memories)
        self.near = self._near(legs / seconds, near)
        self.far = self._far(legs / seconds, near)
        start = kernel.D[m].astype(np.float64)[:, None] / seconds
        there = np.arange(m, dtype=np.intp)[:, None]
        self.first = self._leap(start, there * self.memories, there, np.zeros((m, 1), dtype=bool))
        leaps = [self.near, self.first, *(ring.leap for ring in self.far)]
        #: the most rows a step takes
        self.longest = int(max(leap.rows.max() for leap in leaps)) + 1

    def memory(self, visited: NDArray[np.bool_], place: Ints) -> Ints:
        """The states (k,) at `place` (k,) after `visited` (k, m)."""
        kept = np.take_along_axis(visited, self.remembered[place], axis=1)
        state: Ints = place * self.memories + kept @ (1 << np.arange(kept.shape[1]))
        return state

    def _leap(self, q: Array, state: Ints, place: Ints, barred: NDArray[np.bool_]) -> Leap:
        rows = np.floor(q).astype(np.intp)
        barrier = np.where(barred, NEVER, 0.0)
        return Leap(rows * self.states + state, rows, q - rows, barrier, place, state)

    def _near(self, q: Array, near: Ints) -> Leap:
        m, k = near.shape
        bits = np.arange(self.memories)[:, None] >> np.arange(self.remembered.shape[1]) & 1
        come = np.zeros((m, self.memories, m), dtype=bool)
        come[np.arange(m), :, np.arange(m)] = True
        here, memory = np.arange(m)[:, None, None], np.arange(self.memories)[:, None]
        come[here, memory, self.remembered[:, None, :]] = bits == 1
        place = np.broadcast_to(near[:, None, :], (m, self.memories, k)).reshape(self.states, k)
        come = come.reshape(self.states, m)
        kept = come[np.arange(self.states)[:, None, None], self.remembered[place]]
        state = place * self.memories + kept @ (1 << np.arange(kept.shape[2]))
        barred = np.take_along_axis(come, place, axis=1)
        rows = np.take_along_axis(q[self.place], place, axis=1)
        return self._leap(*(np.ascontiguousarray(x.T) for x in (rows, state, place, barred)))

    def _far(self, q: Array, near: Ints) -> tuple[Ring, ...]:
        far = np.isfinite(q)
        np.put_along_axis(far, near, False, axis=1)
        rings = []
        for block, beyond in zip(_BLOCKS, (*_BLOCKS[1:], np.inf), strict=True):
            within = far & (q >= block) & (q < beyond)
            most = int(within.sum(axis=1).max())
            if not most:
                continue
            # the places within first; those that fill up the rows are barred
            place = np.argsort(~within, axis=1, kind="stable")[:, :most]
            barred = ~np.take_along_axis(within, place, axis=1)
            length = np.where(barred, block, np.take_along_axis(q, place, axis=1))
            place = np.ascontiguousarray(place.T)
            leap = self._leap(length.T.copy(), place * self.memories, place, barred.T)
            rings.append(Ring(leap, block))
        return tuple(rings)
