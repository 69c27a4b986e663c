"""Better and better orders until a deadline: ratio rule, local search, small kicks."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.moves import apply_best, far_moves, moves
from planner.ordering.segments import Legs, Order, legs_of

#: nearest places to which new legs are tried
NEIGHBOURS = 8
#: places whose moves are priced at once
_BATCH = 1024
#: longest stretch a kick moves
LONGEST = 12
#: from here on sorting the legs of every place would take longer than the search may
MANY = 2000
#: powers of the probability for further orders to begin with
_POWERS = (0.5,)
#: the longest legs between which stretches are exchanged, and how many are drawn after each kick,
#: by length to this power
_CUTS, _DRAWN_CUTS, _DRAWN = 16, 20, 1.5
#: a gain must exceed this share of the cost: rounding must not make a search go in circles
_LEAST = 1e-12


def by_ratio(kernel: Kernel, power: float = 1.0) -> Ints:
    """Always on to the place with the most probability a second: the constructive ratio rule.

    With another `power` of the probability less or more depends on it, on the way the rest.
    """
    order = np.empty(kernel.size, dtype=np.intp)
    chance = (kernel.w**power).astype(kernel.D.dtype)
    rate, at = np.empty_like(chance), kernel.root
    for k in range(kernel.size):
        # whole rows: a gather of those that are left takes longer
        np.add(kernel.D[at], 1e-9, out=rate)
        np.divide(chance, rate, out=rate)
        order[k] = at = int(np.argmax(rate))
        chance[at] = -np.inf
    return order


def near(kernel: Kernel, order: Ints, count: int = NEIGHBOURS) -> Ints:
    """(m + 1, count) places to try after each place, row by row.

    The quickest to reach and look over; of very many places, those that follow soon in `order`.
    """
    if kernel.size > MANY:
        following = np.append(kernel.root, order)
        at = np.minimum(np.arange(kernel.size + 1)[:, None] + np.arange(2, count + 2), kernel.size)
        rows = np.empty((kernel.size + 1, count), dtype=np.intp)
        rows[following] = following[at]
        return rows
    D = kernel.D.copy()
    np.fill_diagonal(D, np.inf)
    count = min(count, kernel.size - 1)
    return np.argpartition(D, count - 1, axis=1)[:, :count]


def descend(order: Order, around: Ints, near_to: Ints, late: Callable[[], bool]) -> Order:
    """Apply improving moves that begin at places `around` until there are none, or it is late."""
    while len(around) and not late():
        around, rest = around[:_BATCH], around[_BATCH:]
        a = np.repeat(around, near_to.shape[1])
        b = near_to[around].ravel()
        found = moves(order, a, b)
        places, ends = apply_best(order, found, _LEAST * order.cost)
        better = Order(order.legs, places) if ends else order
        if better.cost < order.cost:
            order, around = better, np.union1d(rest, better.place[:-1][ends])
        else:
            around = rest
    return order


def improve(
    kernel: Kernel, start: Ints, deadline: float, seed: int, kicks: int | None = None
) -> tuple[Ints, float]:
    """The best order found from `start` until `deadline` (of time.perf_counter), and its cost.

    `kicks` bounds the work instead where results must not depend on the machine's speed.
    """

    def late() -> bool:
        return time.perf_counter() > deadline

    legs, near_to = legs_of(kernel), near(kernel, start)
    best, done = _from(legs, start, near_to, late), 0
    for power in _POWERS:
        if kernel.size <= MANY and not late():
            other = _from(legs, by_ratio(kernel, power), near_to, late)
            best = min(best, other, key=lambda order: order.cost)
    rng = np.random.default_rng(seed)
    while not late() and best.end > 3 and (kicks is None or done < kicks):
        best = _kick(best, legs, near_to, rng, late)
        if kernel.size <= MANY and not late():
            best = _cut(best, rng, near_to, late)
        done += 1
    return best.place[1:-1].copy(), best.cost


def _from(legs: Legs, start: Ints, near_to: Ints, late: Callable[[], bool]) -> Order:
    """`start`, improved until no move gains anything."""
    order = descend(Order(legs, start), np.arange(len(start) + 1), near_to, late)
    return order if len(start) > MANY else _longest_cut(order, near_to, late)


def _longest_cut(order: Order, near_to: Ints, late: Callable[[], bool]) -> Order:
    """Exchange and turn what lies between the longest legs until nothing is gained."""
    while not late():
        places = order.place[: order.end + 1]
        legs = order.legs(places[:-1], places[1:])
        cuts = np.sort(np.argsort(-legs, kind="stable")[:_CUTS]) + 1
        better = _recut(order, cuts, near_to, late)
        if better is order:
            break
        order = better
    return order


def _cut(order: Order, rng: np.random.Generator, near_to: Ints, late: Callable[[], bool]) -> Order:
    """The same between legs drawn by their length."""
    places = order.place[: order.end + 1]
    legs = order.legs(places[:-1], places[1:])
    drawn = rng.exponential(size=len(legs)) / np.maximum(legs, 1e-9) ** _DRAWN
    return _recut(order, np.sort(np.argsort(drawn, kind="stable")[:_DRAWN_CUTS]) + 1, near_to, late)


def _recut(order: Order, cuts: Ints, near_to: Ints, late: Callable[[], bool]) -> Order:
    places, ends = apply_best(order, far_moves(order, cuts), _LEAST * order.cost)
    better = Order(order.legs, places) if ends else order
    if better.cost >= order.cost:
        return order
    return descend(better, np.unique(better.place[:-1][ends]), near_to, late)


def _kick(
    best: Order, legs: Legs, near_to: Ints, rng: np.random.Generator, late: Callable[[], bool]
) -> Order:
    """`best` with two neighbouring stretches exchanged, improved again; whichever is better."""
    longest = min(best.end // 2, LONGEST)
    one, two = (int(length) for length in rng.integers(1, longest + 1, 2))
    i = int(rng.integers(1, max(2, best.end - one - two + 2)))
    c, j = i + one - 1, min(i + one + two - 1, best.end)
    places = best.place[1:-1].copy()
    places[i - 1 : j] = np.concatenate([best.place[c + 1 : j + 1], best.place[i : c + 1]])
    ends = np.array([i - 1, i, i + j - c - 1, i + j - c, j, min(j + 1, len(places))])
    kicked = Order(legs, places)
    kicked = descend(kicked, np.unique(kicked.place[:-1][ends]), near_to, late)
    return kicked if kicked.cost < best.cost - _LEAST * best.cost else best
