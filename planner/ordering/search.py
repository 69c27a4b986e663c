"""Better and better orders until a deadline, compiled: as `improve`, many times as fast.

Several ratio rules to begin with, each improved and kicked a while; the best is gone on from. A
kick exchanges two neighbouring stretches, short ones anywhere or any between long legs, and the
order is improved again; it is kept if that made it better. The seed determines every step, the
clock only ends them.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from planner.ordering.compiled import compiled
from planner.ordering.descent import (
    LEAST,
    Flags,
    Seed,
    best_cut,
    descend,
    draw_cuts,
    drawn_share,
    ends_wait,
    last_worth,
    made,
)
from planner.ordering.improve import LONGEST, NEIGHBOURS, by_ratio, near
from planner.ordering.kernel import Ints, Kernel
from planner.ordering.memories import Array, Whole
from planner.ordering.stretches import COST, ROWS, make, renew

#: powers of the probability in the ratio rules to begin with, and kicks of each
_POWERS, _BEGIN = (1.0, 0.5, 0.25, 1.5), 100
#: share of kicks between long legs, how many cuts such a stretch may span, and after how many kicks
#: every exchange between long legs is priced
_FAR, _SPAN, _EVERY = 0.4, 4, 4
#: in the model `any`: a place is never quite sure, so that what is left can be divided by
_SUREST = 1.0 - 1e-9
#: kicks, and places that waited, between two looks at the clock
_AT_ONCE, _WAITING = 8, 256


def searched(
    kernel: Kernel, deadline: float, seed: int, kicks: int | None = None
) -> tuple[Ints, float]:
    """The best order found until `deadline` (of time.perf_counter), and its cost.

    `kicks` bounds the work instead where results must not depend on the machine's speed.
    """

    def late() -> bool:
        return time.perf_counter() > deadline

    best = Search(kernel, by_ratio(kernel), seed)
    best.run(_BEGIN if kicks is None else min(kicks, _BEGIN), late)
    for power in _POWERS[1:]:
        if late():
            break
        other = Search(kernel, by_ratio(kernel, power), seed)
        other.run(_BEGIN if kicks is None else min(kicks, _BEGIN), late)
        best = min(best, other, key=lambda search: search.cost)
    best.run(kicks, late)
    return best.order, best.cost


class Search:
    """A search that goes on from where it was, with an order that only gets better."""

    def __init__(self, kernel: Kernel, start: Ints, seed: int) -> None:
        m = kernel.size
        w = np.minimum(kernel.w, _SUREST) if kernel.any else kernel.w
        legs = np.zeros((m + 1, m + 1))
        legs[:, :m] = kernel.D
        place = np.full(m + 2, m, dtype=np.int64)
        place[1:-1] = start
        self._place, self._kicked = place, 0
        self._position, self._sums = np.zeros(m + 1, dtype=np.int64), np.zeros((ROWS, m + 2))
        # all places wait, in their order
        self._queue, self._ends = place[:-1].copy(), np.array([0, m + 1])
        self._waits = np.ones(m + 1, dtype=np.bool_)
        self._seed = np.array([seed % (1 << 64)], dtype=np.uint64)
        self._given = (legs, w, 1.0 - w if kernel.any else np.ones(m))
        self._near = near(kernel, start, NEIGHBOURS).astype(np.int64)
        self._move, self._room = np.zeros(4, dtype=np.int64), place.copy()
        renew(self._place, self._position, self._sums, *self._given, 1)

    @property
    def order(self) -> Ints:
        """(m,) the order."""
        return self._place[1:-1].astype(np.intp)

    @property
    def cost(self) -> float:
        """What it costs."""
        return float(self._sums[COST, len(self._place) - 2])

    def run(self, kicks: int | None, late: Callable[[], bool]) -> None:
        """Improve the order until no move gains anything, then by so many `kicks`."""
        state = (
            self._place, self._position, self._sums, *self._given, self._near, self._queue,
            self._waits, self._ends, self._move, self._room,
        )  # fmt: skip
        while self._ends[1] > 0:
            descend(*state, _WAITING)
            if late():
                return
        done = 0
        while not late() and (kicks is None or done < kicks):
            some = _AT_ONCE if kicks is None else min(_AT_ONCE, kicks - done)
            if not _kicks(*state, self._seed, self._kicked, some):
                return
            done, self._kicked = done + some, self._kicked + some


@compiled("b1(i8[::1],f8[:,::1],i8,u8[::1],i8[::1])")
def _drawn(place: Whole, legs: Array, end: int, seed: Seed, move: Whole) -> bool:
    """Draw two neighbouring stretches to exchange; whether there are some."""
    if end < 4:
        return False
    if drawn_share(seed) < _FAR:
        cuts = draw_cuts(place, legs, end, seed)
        k = len(cuts)
        x = int(drawn_share(seed) * (k - 2))
        y = x + 1 + int(drawn_share(seed) * min(_SPAN, k - x - 2))
        z = y + 1 + int(drawn_share(seed) * min(_SPAN, k - y - 1))
        move[0], move[1], move[2], move[3] = cuts[x], cuts[y] - 1, cuts[z] - 1, 0
        return True
    longest = min(end // 2, LONGEST)
    one, two = 1 + int(drawn_share(seed) * longest), 1 + int(drawn_share(seed) * longest)
    i = 1 + int(drawn_share(seed) * max(1, end - one - two + 1))
    move[0], move[1], move[2], move[3] = i, i + one - 1, min(i + one + two - 1, end), 0
    return True


@compiled(
    "b1(i8[::1],i8[::1],f8[:,::1],f8[:,::1],f8[::1],f8[::1],i8[:,::1],i8[::1],b1[::1],i8[::1],"
    "i8[::1],i8[::1],u8[::1],i8,i8)"
)
def _kicks(
    place: Whole, position: Whole, sums: Array, legs: Array, w: Array, keep: Array, near_to: Whole,
    queue: Whole, waits: Flags, ends: Whole, move: Whole, room: Whole, seed: Seed, first: int,
    count: int,
) -> bool:  # fmt: skip
    """Kicks number `first` and on, so many; whether any can be made."""
    m, every = len(w), 1 << 62
    before = place.copy()
    for kick in range(first, first + count):
        cost = sums[COST, m]
        if not _drawn(place, legs, last_worth(sums, m), seed, move):
            return False
        before[:] = place
        lowest = move[0]
        make(place, lowest, move[1], move[2], 0, room)
        renew(place, position, sums, legs, w, keep, lowest)
        ends_wait(move, place, queue, waits, ends)
        descend(
            place, position, sums, legs, w, keep, near_to, queue, waits, ends, move, room, every
        )
        if kick % _EVERY == 0:
            end, least = last_worth(sums, m), LEAST * cost
            cuts = draw_cuts(place, legs, end, seed)
            found = best_cut(place, cuts, sums, legs, end, least, move)
            if found > least and made(move, place, position, sums, legs, w, keep, room):
                ends_wait(move, place, queue, waits, ends)
                descend(
                    place, position, sums, legs, w, keep, near_to, queue, waits, ends, move, room,
                    every,
                )  # fmt: skip
        if not sums[COST, m] < cost * (1.0 - LEAST):
            place[:] = before
            renew(place, position, sums, legs, w, keep, 1)
    return True
