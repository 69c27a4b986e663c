"""What walks remember, for compiled steps: states, and which step leads from which to which.

A place remembers a few others: while a walk that has come through one of these stands there, or
goes on by places that all remember it too, it may not visit it again (ng-routes, Baldacci, Mingozzi
and Roberti 2011). A state is a place and which of its remembered places have been come through.
A step between places that remember nothing in common, nor each other, is free: memory has no part
in it. Other steps are bound: for each memory before there is one after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.ordering.compiled import compiled
from planner.ordering.kernel import Kernel

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
States = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Memories:
    """Lists one after another; entries of place i from pointer[i] to pointer[i + 1]."""

    pointer: Whole  # (m + 1,) into `remembered`
    remembered: Whole  # places
    first: Whole  # (m + 1,) state of each place without memory; the rest of its states follow
    bound: Whole  # (m + 1,) into `to` and `map`
    to: Whole  # where the bound steps lead
    map: Whole  # and where in `after` the states they lead to begin
    after: States  # for each memory before, the state after a bound step; -1 where it is barred
    free: NDArray[np.bool_]  # (m, m) whether a step is free

    @property
    def states(self) -> int:
        """How many there are."""
        return int(self.first[-1])

    @classmethod
    def nearest(cls, kernel: Kernel, count: int) -> Memories:
        """Each place remembers the `count` that take least to go to and come back from."""
        m = kernel.size
        legs = kernel.D[:m].astype(np.float64)
        np.fill_diagonal(legs, np.inf)
        both = np.argsort(legs + legs.T, axis=1, kind="stable")[:, : min(count, m - 1)]
        return cls.of(m, list(both.astype(np.int64)))

    @classmethod
    def of(cls, m: int, lists: list[Whole]) -> Memories:
        """`lists` names the places each of `m` places remembers, without itself."""
        pointer = np.concatenate([[0], np.cumsum([len(each) for each in lists])]).astype(np.int64)
        remembered = np.concatenate([*lists, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(1 << np.diff(pointer))]).astype(np.int64)
        bit = np.full((m, m), -1, dtype=np.int64)
        for here, each in enumerate(lists):
            bit[here, each] = np.arange(len(each))
        knows = (bit >= 0).astype(np.float32)
        free = (knows @ knows.T == 0) & (bit < 0) & (bit.T < 0)
        np.fill_diagonal(free, False)
        barred = ~free & ~np.eye(m, dtype=bool)
        place, to = (each.astype(np.int64) for each in np.nonzero(barred))
        bound = np.concatenate([[0], np.cumsum(barred.sum(axis=1))]).astype(np.int64)
        counts = (1 << np.diff(pointer))[place]
        start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        after = np.empty(max(int(start[-1]), 1), dtype=np.int32)
        _after(place, to, start, pointer, remembered, first, bit, after)
        return cls(pointer, remembered, first, bound, to, start[:-1].copy(), after, free)


@compiled("void(i8[::1],i8[::1],i8[::1],i8[::1],i8[::1],i8[::1],i8[:,::1],i4[::1])")
def _after(
    place: Whole,
    to: Whole,
    start: Whole,
    pointer: Whole,
    remembered: Whole,
    first: Whole,
    bit: Whole,
    after: States,
) -> None:
    for e in range(len(place)):
        i, j, begin = place[e], to[e], start[e]
        own = pointer[i + 1] - pointer[i]
        for memory in range(1 << own):
            state = 0
            if bit[j, i] >= 0:
                state = 1 << bit[j, i]
            for b in range(own):
                kept = bit[j, remembered[pointer[i] + b]]
                if (memory >> b) & 1 and kept >= 0:
                    state |= 1 << kept
            barred = bit[i, j] >= 0 and (memory >> bit[i, j]) & 1
            after[begin + memory] = -1 if barred else first[j] + state
