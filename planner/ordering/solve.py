"""The order of least expected time to find, as good as the time allows, with a proven bound."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.errors import OrderingError
from planner.ordering.improve import MANY, by_ratio, improve
from planner.ordering.kernel import Ints, Kernel, reduce_problem
from planner.ordering.potentials import best_bound, quick_bound
from planner.ordering.problem import OrderingProblem
from planner.ordering.prove import prove
from planner.ordering.subsets import MOST, best_order
from planner.ordering.walks import Known, coarsest_step, raise_prices

#: places up to which all subsets can be gone through in half a second
_SUBSETS = 17
#: share of the time spent on orders; the rest goes into the bound
_ON_ORDERS = 0.6
#: up to so many places walks bound the model `single`; fine steps and a proof only up to so many
_WALKED, _FINE = 60, 36
#: share of the time spent on orders of that few
_ON_FEW = 0.2
#: share of what is left after that for split legs
_ON_SPLITS = 0.15
#: how much finer the fine steps are
_FINER = 6
#: share of the time limit kept back for what cannot be interrupted
_RESERVE = 0.08
#: rounding: by how much less than computed a bound is said to be
_EXACT, _ROUNDED, _SINGLE = 1e-12, 1e-9, 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Ordering:
    """An order and what is known about it."""

    order: NDArray[np.intp]  # (n,) all places; those that cannot help come last
    expected_seconds: float  # [s] to find, given that it is somewhere
    lower_bound: float  # [s] no order takes less
    proven: bool  # whether the order is optimal
    seconds: float  # [s] it took to plan

    @property
    def gap(self) -> float:
        """How much better an order could be at most, as a share of the expected time."""
        expected = self.expected_seconds
        return 1.0 - self.lower_bound / expected if expected > 0 else 0.0


def solve(problem: OrderingProblem, time_limit: float = 1.0, seed: int = 0) -> Ordering:
    """Order the places of `problem` within `time_limit` seconds.

    Up to 14 places with some probability the order is optimal. Beyond, the limit ends the search
    between steps that `seed` determines: more time continues the same search. Raises OrderingError
    for a limit that is not positive.
    """
    if not 0 < time_limit < float("inf"):
        raise OrderingError(f"the time limit must be above 0 s, got {time_limit}")
    begin = time.perf_counter()
    kernel = reduce_problem(problem)
    if kernel.size <= MOST or (kernel.size <= _SUBSETS and time_limit >= 0.5):
        order, bound = best_order(kernel), np.inf
    else:
        order, bound = _anytime(kernel, begin, time_limit, seed)
    rounded = _ROUNDED if kernel.D.dtype == np.float64 else _SINGLE
    whole = np.concatenate([kernel.sites[order], kernel.rest])
    expected = problem.expected_seconds(whole)
    proven = bound >= kernel.cost(order) * (1 - _ROUNDED)
    lower = expected * (1 - _EXACT) if proven else bound / kernel.norm * (1 - rounded)
    return Ordering(whole, expected, lower, bool(proven), time.perf_counter() - begin)


def _anytime(kernel: Kernel, begin: float, limit: float, seed: int) -> tuple[Ints, float]:
    end = begin + limit * (1 - _RESERVE)
    order = by_ratio(kernel)
    if kernel.size > MANY:
        bound = quick_bound(kernel)
        return improve(kernel, order, end, seed)[0], bound
    now = time.perf_counter()
    if kernel.size <= _WALKED and not kernel.any:
        order, _ = improve(kernel, order, now + (end - now) * _ON_FEW, seed)
        return _walked(kernel, order, end)
    order, cost = improve(kernel, order, now + (end - now) * _ON_ORDERS, seed)
    return order, best_bound(kernel, cost, end)


def _walked(kernel: Kernel, order: Ints, end: float) -> tuple[Ints, float]:
    """A bound from walks, and the proof that it may lead to."""
    known = Known.of(kernel, order)
    step = coarsest_step(kernel, known.total)
    if step is None:
        return order, best_bound(kernel, known.cost, end)
    now = time.perf_counter()
    bound = best_bound(kernel, known.cost, now + (end - now) * _ON_SPLITS)
    few = kernel.size <= _FINE
    walks = raise_prices(
        kernel, known, known.price, step, now + (end - now) * (0.5 if few else 0.9)
    )
    now = time.perf_counter()
    if few and walks.seconds * _FINER * 2 < end - now:
        until = now + (end - now) * 0.3
        walks = raise_prices(kernel, known, walks.price, step / _FINER, until)
        now = time.perf_counter()
        better = prove(kernel, walks, known.cost, now + (end - now) * 0.7)
        if better is not None:
            order = better if len(better) else order
            return order, kernel.cost(order)
    return order, max(bound, walks.bound)
