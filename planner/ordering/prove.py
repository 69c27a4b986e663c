"""Proof by exhaustion: the subsets that could still lead to a better order, and no others.

The dynamic programme of `subsets`, place by place, where a way to have visited a set is dropped as
soon as the time spent on it and a bound on what must follow exceed the best order known (forward
dynamic programming with completion bounds, Lawler and others).
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.segments import Array
from planner.ordering.walks import Walks

Masks = NDArray[np.int64]
#: ways kept at once for each second there is: about as many as can be followed
_WAYS_A_SECOND = 120_000


class _Ways(NamedTuple):
    """Ways to begin an order; fields (k,)."""

    visited: Masks  # the places visited, one bit each
    last: Ints
    cost: Array  # legs x probability left before them
    seconds: Array  # [s]
    parent: Ints  # which way of the step before


def prove(kernel: Kernel, walks: Walks, cost: float, deadline: float) -> Ints | None:
    """The optimal order (m,), an empty one where none beats `cost`; None without a proof in time.

    For the model `single` and up to 62 places.
    """
    most = _WAYS_A_SECOND * (deadline - time.perf_counter())
    here, none = np.array([kernel.root]), np.zeros(1)
    steps = [_Ways(np.zeros(1, np.int64), here, none, none, np.zeros(1, np.intp))]
    for _ in range(kernel.size):
        ways = _onward(kernel, walks, steps[-1], cost * (1 - 1e-11))
        if not len(ways.last):
            return np.empty(0, dtype=np.intp)
        if len(ways.last) > most or time.perf_counter() > deadline:
            return None
        steps.append(ways)
    return _trace(steps)


def _onward(kernel: Kernel, walks: Walks, ways: _Ways, most: float) -> _Ways:
    bits = np.int64(1) << np.arange(kernel.size, dtype=np.int64)
    parent, place = np.nonzero((ways.visited[:, None] & bits) == 0)
    left = 1.0 - _sum_of_bits(ways.visited, kernel.w)
    earned = walks.price.sum() - _sum_of_bits(ways.visited, walks.price)
    legs = kernel.D[ways.last[parent], place]
    cost, seconds = ways.cost[parent] + legs * left[parent], ways.seconds[parent] + legs
    spent = cost - (left[parent] - kernel.w[place]) * seconds
    least = spent + earned[parent] - walks.price[place] + walks.at(seconds, place)
    good = np.flatnonzero(least < most)
    found = _Ways(
        ways.visited[parent[good]] | bits[place[good]], place[good], cost[good], seconds[good],
        parent[good],
    )  # fmt: skip
    order = np.lexsort((found.cost, found.last, found.visited))
    visited, last = found.visited[order], found.last[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (visited[1:] != visited[:-1]) | (last[1:] != last[:-1])
    best = order[new]
    return _Ways(visited[new], last[new], found.cost[best], found.seconds[best], found.parent[best])


def _sum_of_bits(visited: Masks, values: Array) -> Array:
    total = np.zeros(len(visited))
    for bit, value in enumerate(values):
        total += ((visited >> bit) & 1) * value
    return total


def _trace(steps: list[_Ways]) -> Ints:
    way, order = int(np.argmin(steps[-1].cost)), []
    for ways in reversed(steps[1:]):
        order.append(int(ways.last[way]))
        way = int(ways.parent[way])
    return np.array(order[::-1], dtype=np.intp)
