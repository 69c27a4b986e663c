"""Orders of places: nearest neighbour, and the ratio rule improved by 2-opt and or-opt."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

MAX_CHAIN = 3  # rooms that or-opt moves as one
MAX_IMPROVED = 50  # rooms up to which the ratio rule's order is improved
_MIN_GAIN = 1e-12  # share of the cost, so that rounding cannot make the search cycle


def room_order(p: Floats, first: Floats, between: Floats) -> Ints:
    """Order (n,) of n rooms with little expected time until found: a local optimum.

    Args:
        p: (n,) probability that the object is in each room.
        first: (n,) [s] from the start to the end of each room's search.
        between: (n, n) [s] from the end of room i's search to the end of room j's.
    """
    order = ratio_rule(p, first, between)
    if not 1 < len(p) <= MAX_IMPROVED:
        return order
    moves = np.array(list(_moves(len(p))))
    cost = float(expected_cost(order[None], p, first, between)[0])
    while True:
        costs = expected_cost(order[moves], p, first, between)
        best = int(np.argmin(costs))
        if not costs[best] < cost * (1 - _MIN_GAIN):
            return order
        order, cost = order[moves[best]], float(costs[best])


def ratio_rule(p: Floats, first: Floats, between: Floats) -> Ints:
    """Greedy order (n,): next is the room with the greatest probability per second.

    The arguments are those of `room_order`.
    """
    rest, seconds, order = p.astype(np.float64), first, list[int]()
    for _ in range(len(p)):
        order.append(int(np.argmax(rest / np.maximum(seconds, 1e-9))))
        rest[order[-1]], seconds = -np.inf, between[order[-1]]
    return np.array(order, np.intp)


def expected_cost(orders: Ints, p: Floats, first: Floats, between: Floats) -> Floats:
    """(k,) [s] sum of probability x time of arrival, for `orders` (k, n)."""
    legs = np.hstack([first[orders[:, :1]], between[orders[:, :-1], orders[:, 1:]]])
    cost: Floats = (p[orders] * np.cumsum(legs, axis=1)).sum(axis=1)
    return cost


def _moves(n: int) -> Iterator[list[int]]:
    """Permutations of n positions: a stretch reversed, or a chain moved."""
    for i in range(n):
        for j in range(i + 2, n + 1):
            yield [*range(i), *reversed(range(i, j)), *range(j, n)]
    for length in range(1, min(MAX_CHAIN, n - 1) + 1):
        for i in range(n - length + 1):
            rest = [*range(i), *range(i + length, n)]
            for at in range(len(rest) + 1):
                if at != i:
                    yield [*rest[:at], *range(i, i + length), *rest[at:]]


T = TypeVar("T")


def nearest_neighbour(items: Iterable[T], metres: Callable[[T | None, T], float]) -> Iterator[T]:
    """Yields `items` in nearest-neighbour order; of equally near items, the first one first.

    `metres(here, item)` is the distance [m] from the item yielded last, None at the start. It is
    called again before each item, so that it may depend on the robot's position at that time.
    """
    left, here = list(items), None
    while left:
        distances = [metres(here, item) for item in left]
        here = left.pop(distances.index(min(distances)))
        yield here
