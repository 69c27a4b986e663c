"""Better and better orders until a deadline: ratio rule, local search, small kicks."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.moves import apply_best, moves
from planner.ordering.segments import Legs, Order, legs_of

#: nearest places to which new legs are tried
NEIGHBOURS = 8
#: a gain must exceed this share of the cost: rounding must not make a search go in circles
_LEAST = 1e-12


def by_ratio(kernel: Kernel) -> Ints:
    """Always on to the place with the most probability a second: the constructive ratio rule."""
    m = kernel.size
    chance = np.where(kernel.w < 1, kernel.w, 1.0)
    order = np.empty(m, dtype=np.intp)
    left, at = np.arange(m), kernel.root
    legs = np.maximum(kernel.D, 1e-9)
    for k in range(m):
        best = int(np.argmax(chance[left] / legs[at, left]))
        order[k] = at = left[best]
        left = np.delete(left, best)
    return order


def near(kernel: Kernel, count: int = NEIGHBOURS) -> Ints:
    """(m + 1, count) the places that are quickest to reach and look over, row by row."""
    D = kernel.D.copy()
    np.fill_diagonal(D, np.inf)
    count = min(count, kernel.size - 1)
    return np.argpartition(D, count - 1, axis=1)[:, :count]


def descend(order: Order, around: Ints, near_to: Ints, late: Callable[[], bool]) -> Order:
    """Apply improving moves that begin at places `around` until there are none, or it is late."""
    while len(around) and not late():
        a = np.repeat(around, near_to.shape[1])
        b = near_to[around].ravel()
        found = moves(order, a, b)
        places, ends = apply_best(order, found, _LEAST * order.cost)
        if not ends:
            break
        better = Order(order.legs, places)
        if better.cost >= order.cost:
            break
        order, around = better, np.unique(better.place[:-1][ends])
    return order


def improve(
    kernel: Kernel, start: Ints, deadline: float, seed: int, kicks: int | None = None
) -> tuple[Ints, float]:
    """The best order found from `start` until `deadline` (of time.perf_counter), and its cost.

    `kicks` bounds the work instead where results must not depend on the machine's speed.
    """
    late = lambda: time.perf_counter() > deadline  # noqa: E731
    legs, near_to = legs_of(kernel), near(kernel)
    best = descend(Order(legs, start), np.arange(kernel.size + 1), near_to, late)
    rng = np.random.default_rng(seed)
    done = 0
    while not late() and best.end > 3 and (kicks is None or done < kicks):
        best = _kick(best, legs, near_to, rng, late)
        done += 1
    improve.done = done
    return best.place[1:-1].copy(), best.cost


def _kick(
    best: Order, legs: Legs, near_to: Ints, rng: np.random.Generator, late: Callable[[], bool]
) -> Order:
    """`best` with two neighbouring stretches exchanged, improved again; whichever is better."""
    longest = max(2, min(best.end // 3, 12))
    one, two = rng.integers(1, longest, 2)
    i = int(rng.integers(1, max(2, best.end - one - two + 2)))
    c, j = i + one - 1, min(i + one + two - 1, best.end)
    places = best.place[1:-1].copy()
    places[i - 1 : j] = np.concatenate([best.place[c + 1 : j + 1], best.place[i : c + 1]])
    ends = np.array([i - 1, i, i + j - c - 1, i + j - c, j, min(j + 1, len(places))])
    kicked = Order(legs, places)
    kicked = descend(kicked, np.unique(kicked.place[:-1][ends]), near_to, late)
    return kicked if kicked.cost < best.cost - _LEAST * best.cost else best
