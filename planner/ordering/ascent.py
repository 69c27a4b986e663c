"""Prices that raise the bound of walks, step by step along its slope (Lagrange)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planner.ordering.memories import Array

#: steps without a better bound after which steps become shorter
_PATIENCE, _SHORTER = 3, 0.7
#: how much of its direction a step keeps from the one before
_KEPT = 0.7
#: a better bound is better by this share
_BETTER = 1e-6
#: a step is begun where so many times what the last took is left
_SPARE = 1.2


class Priced(Protocol):
    """Walks with a price on every place."""

    def bound(self, price: Array) -> float:
        """What every order costs at least, by the cheapest walk at `price` (m,)."""

    def visits(self, draw: int) -> Array:
        """(m,) how often the walk last found visits each place; `draw` seeds what is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Prices:
    """The best prices found."""

    bound: float  # of every order's cost
    price: Array  # (m,)


def ascend(
    walks: Priced,
    start: Array,
    weight: Array,
    cost: float,
    deadline: float,
    scale: float = 1.0,
    least: float = 0.005,
    most: int = 100_000,
) -> Prices:
    """The best of at most `most` steps until `deadline` (of time.perf_counter).

    `start` (m,) are prices to begin with and `weight` (m,), positive, how much each may change.
    Steps begin at `scale` of the whole way to `cost`, a known order's, and end at `least` of it.
    """
    begin = time.perf_counter()
    at, found = start, walks.bound(start)
    best, since, drift = Prices(found, start), 0, np.zeros_like(start)
    visits = best_visits = walks.visits(0)
    for step in range(most):
        now = time.perf_counter()
        if now + _SPARE * (now - begin) > deadline or scale < least:
            break
        begin = now
        slope = 1.0 - visits
        steep = float(slope @ (weight * slope))
        if steep < 1e-12 * float(weight.sum()):
            break
        drift = _KEPT * drift + (1.0 - _KEPT) * weight * slope
        at = at + drift * (scale * max(cost - found, 1e-3 * cost) / steep)
        found, visits = walks.bound(at), walks.visits(step + 1)
        since += 1
        if found > best.bound + _BETTER * abs(best.bound):
            best, best_visits, since = Prices(found, at), visits, 0
        elif since >= _PATIENCE:
            scale, since, drift = scale * _SHORTER, 0, np.zeros_like(at)
            found, at, visits = best.bound, best.price, best_visits
    return best
