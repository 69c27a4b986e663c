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
from planner.ordering.steps import Array
from planner.ordering.walks import Values, Walks

Masks = NDArray[np.int64]
#: ways kept at once for each second there is: about as many as can be followed
_WAYS_A_SECOND = 120_000
#: fewer ways than that take no time; more take longer each than those of the layer before
_SOME, _SLOWER = 20_000, 1.6


class _Ways(NamedTuple):
    """Ways to begin an order; fields (k,)."""

    visited: Masks  # the places visited, one bit each
    last: Ints
    cost: Array  # legs x probability left before them
    seconds: Array  # [s]
    spent: Array  # sum of a x phi(arrival) of the places visited
    parent: Ints  # which way of the step before


def prove(
    kernel: Kernel, walks: Walks, values: Values, deadline: float, cost: float
) -> Ints | None:
    """The optimal order (m,), an empty one where none beats `cost`; None without a proof in time.

    For up to 62 places.
    """
    most, pace = _WAYS_A_SECOND * (deadline - time.perf_counter()), 0.0
    here, none = np.array([kernel.root]), np.zeros(1)
    steps = [_Ways(np.zeros(1, np.int64), here, none, none, none, np.zeros(1, np.intp))]
    for left in range(kernel.size, 0, -1):
        begin, longer = time.perf_counter(), left * len(steps[-1].last)
        if longer > _SOME and begin + _SLOWER * pace * longer > deadline:
            return None
        ways = _onward(kernel, walks, values, steps[-1], cost * (1 - 1e-11))
        pace = (time.perf_counter() - begin) / longer
        if not len(ways.last):
            return np.empty(0, dtype=np.intp)
        if len(ways.last) > most or time.perf_counter() > deadline:
            return None
        steps.append(ways)
    return _trace(steps)


def _onward(kernel: Kernel, walks: Walks, values: Values, ways: _Ways, most: float) -> _Ways:
    new = _next(kernel, walks, ways)
    new = _of(new, _least(kernel, walks, values, new) < most)
    order = np.lexsort((new.cost, new.last, new.visited))
    visited, last = new.visited[order], new.last[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (visited[1:] != visited[:-1]) | (last[1:] != last[:-1])
    return _of(new, order[first])


def _next(kernel: Kernel, walks: Walks, ways: _Ways) -> _Ways:
    """Every way, one place longer."""
    bits = np.int64(1) << np.arange(kernel.size, dtype=np.int64)
    parent, place = np.nonzero((ways.visited[:, None] & bits) == 0)
    left = _left(kernel, ways.visited)[parent]
    legs = kernel.D[ways.last[parent], place]
    seconds = ways.seconds[parent] + legs
    spent = ways.spent[parent] + walks.known.a[place] * walks.known.phi(seconds)
    cost = ways.cost[parent] + legs * left
    return _Ways(ways.visited[parent] | bits[place], place, cost, seconds, spent, parent)


def _of(ways: _Ways, which: NDArray[np.bool_] | Ints) -> _Ways:
    return _Ways(
        ways.visited[which], ways.last[which], ways.cost[which], ways.seconds[which],
        ways.spent[which], ways.parent[which],
    )  # fmt: skip


def _least(kernel: Kernel, walks: Walks, values: Values, ways: _Ways) -> Array:
    """What any order that begins like each of `ways` costs at least."""
    been = (ways.visited[:, None] >> np.arange(kernel.size) & 1).astype(bool)
    earned = values.price.sum() - been @ values.price
    state = walks.steps.memory(been, ways.last)
    onward = walks.onward(values, ways.seconds, state)
    least: Array = walks.known.base + ways.spent + earned + onward
    return least


def _left(kernel: Kernel, visited: Masks) -> Array:
    """Probability of a first find after `visited`."""
    been = visited[:, None] >> np.arange(kernel.size) & 1
    if not kernel.any:
        return np.asarray(kernel.w.sum() - been @ kernel.w)
    alone = np.where(been, 1.0 - kernel.w, 1.0).prod(axis=1)
    return np.asarray(alone - (1.0 - kernel.w).prod())


def _trace(steps: list[_Ways]) -> Ints:
    way, order = int(np.argmin(steps[-1].cost)), []
    for ways in reversed(steps[1:]):
        order.append(int(ways.last[way]))
        way = int(ways.parent[way])
    return np.array(order[::-1], dtype=np.intp)
