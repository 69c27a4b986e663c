"""Anytime solver of ordering problems: a good order within a time limit, and a lower bound."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.ordering.cluster_bound import cluster_bound, nearest_leg_bound
from lab.ordering.local_search import MANY, improve, ratio_rule
from lab.ordering.problem import OrderingError, OrderingProblem
from lab.ordering.reduction import Ints, ReducedProblem, reduce_problem
from lab.ordering.subset_dp import MAX_PLACES, best_order

#: places up to which the dynamic programme takes less than half a second
_MAX_PLACES_IN_HALF_A_SECOND = 17
#: share of the time limit for the order; the bound gets the rest
_FOR_THE_ORDER = 0.5
#: share of the time limit kept back for steps that cannot be interrupted
_RESERVE = 0.08
#: relative rounding subtracted from a bound: exact orders, double and single precision
_EXACT, _ROUNDED, _SINGLE = 1e-12, 1e-9, 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Ordering:
    """Order of places with its expected time and a lower bound on that of any order."""

    order: NDArray[np.intp]  # (n,) all places; those that cannot help come last
    expected_seconds: float  # [s] to find, given that it is somewhere
    lower_bound: float  # [s] no order takes less
    proven: bool  # whether the order is optimal
    seconds: float  # [s] computing time

    @property
    def gap(self) -> float:
        """Optimality gap: by what share of the expected time an order could be better at most."""
        expected = self.expected_seconds
        return 1.0 - self.lower_bound / expected if expected > 0 else 0.0


def solve(problem: OrderingProblem, time_limit: float = 1.0, seed: int = 0) -> Ordering:
    """Ordering of the places of `problem`, computed within `time_limit` [s].

    Up to 14 places with some probability the order is optimal (17 where the limit is 0.5 s or
    more). Beyond, local search with perturbations from `seed` runs until the limit. Raises
    OrderingError for a limit that is not positive and finite.
    """
    if not 0 < time_limit < float("inf"):
        raise OrderingError(f"the time limit must be above 0 s, got {time_limit}")
    begin = time.perf_counter()
    reduced = reduce_problem(problem)
    if reduced.size <= (MAX_PLACES if time_limit < 0.5 else _MAX_PLACES_IN_HALF_A_SECOND):
        order, bound = best_order(reduced), np.inf
    else:
        order, bound = _anytime(reduced, begin, time_limit, seed)
    whole = np.concatenate([reduced.sites[order], reduced.rest])
    expected = problem.expected_seconds(whole)
    proven = bound >= reduced.cost(order) * (1 - _ROUNDED)
    lower = expected * (1 - (_EXACT if np.isinf(bound) else _ROUNDED))
    if not proven:
        rounded = _ROUNDED if reduced.D.dtype == np.float64 else _SINGLE
        lower = bound / reduced.norm * (1 - rounded)
    return Ordering(whole, expected, lower, bool(proven), time.perf_counter() - begin)


def _anytime(reduced: ReducedProblem, begin: float, limit: float, seed: int) -> tuple[Ints, float]:
    """Order (m,) and lower bound of its cost, by local search and supergradient steps."""
    end = begin + limit * (1 - _RESERVE)
    order = ratio_rule(reduced)
    if reduced.size > MANY:
        bound = nearest_leg_bound(reduced)
        return improve(reduced, order, end, seed)[0], bound
    now = time.perf_counter()
    order, _ = improve(reduced, order, now + (end - now) * _FOR_THE_ORDER, seed)
    return order, cluster_bound(reduced, order, end)
