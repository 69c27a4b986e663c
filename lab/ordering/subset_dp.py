"""Dynamic programming over subsets (Held and Karp 1962): the optimal order of few places.

As there, with the leg's time weighted by the probability left: that depends on the set
visited before alone, in both models, so the best way to have visited a set and stand at one of its
places is all that has to be kept.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab.ordering.reduction import Floats, Ints, ReducedProblem

#: places up to which this is the method of choice; memory and time grow with m^2 2^m
MAX_PLACES = 14


def probability_left(reduced: ReducedProblem) -> NDArray[np.float64]:
    """(2^m,) probability of a first find after the set of places in the bits has been visited."""
    left = np.ones(1) if reduced.any else np.full(1, reduced.w.sum())
    for weight in reduced.w:
        left = np.concatenate([left, left * (1.0 - weight) if reduced.any else left - weight])
    after: NDArray[np.float64] = np.maximum(left - left[-1], 0.0)
    return after


def best_order(reduced: ReducedProblem) -> Ints:
    """Optimal order (m,), the one of least cost."""
    m = reduced.size
    left = probability_left(reduced)
    cost = np.full((1 << m, m), np.inf)
    cost[1 << np.arange(m), np.arange(m)] = reduced.D[reduced.root] * left[0]
    legs = np.ascontiguousarray(reduced.D[:m].T, dtype=np.float64)
    for layer in _layers(m)[1:-1]:
        for place in range(m):
            before = layer[(layer >> place) & 1 == 0]
            reached = cost[before] + legs[place] * left[before, None]
            cost[before | (1 << place), place] = reached.min(axis=1)
    return _trace(cost, legs, left)


def _trace(cost: Floats, legs: Floats, left: Floats) -> Ints:
    m = cost.shape[1]
    visited, place = (1 << m) - 1, int(np.argmin(cost[-1]))
    order = [place]
    while visited ^ (1 << place):
        visited ^= 1 << place
        place = int(np.argmin(cost[visited] + legs[place] * left[visited]))
        order.append(place)
    return np.array(order[::-1], dtype=np.intp)


@lru_cache(maxsize=20)
def _layers(m: int) -> tuple[Ints, ...]:
    """The subsets of m places as bit masks, by their number of places."""
    size = np.zeros(1, dtype=np.int64)
    for _ in range(m):
        size = np.concatenate([size, size + 1])
    return tuple(np.flatnonzero(size == k) for k in range(m + 1))
