"""The order of least expected time to find, as good as the time allows, with a proven bound."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.errors import OrderingError
from planner.ordering.compiled import fast
from planner.ordering.improve import MANY, by_ratio, improve
from planner.ordering.kernel import Ints, Kernel, reduce_problem
from planner.ordering.potentials import best_split, quick_bound
from planner.ordering.problem import OrderingProblem
from planner.ordering.prove import prove
from planner.ordering.subsets import MOST, best_order
from planner.ordering.tangent import Tangent
from planner.ordering.trees import tree_bound
from planner.ordering.walks import Values, Walks, fits, raise_prices

#: places up to which all subsets can be gone through in half a second
_SUBSETS = 17
#: share of the time spent on orders, where walks bound and of more places; then comes the bound
_ON_ORDERS, _ON_MANY = 0.45, 0.7
#: up to so many places a proof by exhaustion is tried
_FEW = 40
#: share of the time spent on orders of that few, and on prices of what is left after that
_ON_FEW, _ON_PRICES = 0.25, 0.4
#: share of what is left after the orders for clusters, where walks come after them, and a proof;
#: up to so many places, as a step takes as long as the square of them
_ON_TREES, _ON_SPLITS, _TREES = 0.25, 0.08, 700
#: up to so many places a second walks bound; they remember so many others, more before a proof
_WALKED, _MEMORY, _LONG_MEMORY = 85, 3, 6
#: where compiled walks are at hand: the share of the time spent on orders of places that may be
#: proven, and of what is left on split legs
_ON_PROVEN, _ON_FIRST = 0.15, 0.02
#: gap beyond which a proof takes too long to be tried
_HOPELESS = 0.07
#: places that a walk reaches with its memory kept
_NEAREST = 10
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
    exact = _EXACT if np.isinf(bound) else _ROUNDED
    lower = expected * (1 - exact) if proven else bound / kernel.norm * (1 - rounded)
    return Ordering(whole, expected, lower, bool(proven), time.perf_counter() - begin)


def _anytime(kernel: Kernel, begin: float, limit: float, seed: int) -> tuple[Ints, float]:
    end = begin + limit * (1 - _RESERVE)
    order = by_ratio(kernel)
    if kernel.size > MANY:
        bound = quick_bound(kernel)
        return improve(kernel, order, end, seed)[0], bound
    few = kernel.size <= _FEW
    now = time.perf_counter()
    walked = kernel.size <= _WALKED * max(1.0, limit)
    share = _ON_FEW if few else _ON_ORDERS if walked else _ON_MANY
    native = fast()
    if native is not None and not native.fits(kernel):
        native = None
    share = _ON_PROVEN if native is not None else share
    order, cost = improve(kernel, order, now + (end - now) * share, seed)
    if native is not None:
        bound = _without_walks(kernel, order, end, _ON_FIRST if few else _ON_TREES / 2)
        order, walked_bound = native.bounded(kernel, order, end)
        return order, max(bound, walked_bound)
    known = Tangent.of(kernel, order)
    if not walked or not fits(kernel, known, _MEMORY):
        return order, _without_walks(kernel, order, end, 1.0)
    bound = _without_walks(kernel, order, end, _ON_SPLITS if few else _ON_TREES)
    walks = Walks(kernel, known, _MEMORY, _NEAREST)
    now = time.perf_counter()
    until = now + (end - now) * (_ON_PRICES if few else 1.0)
    values = raise_prices(walks, cost, until, 1000)
    if values is not None and few:
        better, values = _exhausted(kernel, walks, values, end)
        if better is not None:
            return (better if len(better) else order), np.inf
    return order, bound if values is None else max(bound, values.bound)


def _without_walks(kernel: Kernel, order: Ints, end: float, share: float) -> float:
    """The bound of clusters, of split legs where places are many, in a share of the time left."""
    now = time.perf_counter()
    until = now + (end - now) * share
    if kernel.size > _TREES:
        return best_split(kernel, kernel.cost(order), until).bound
    native = fast()
    rises = None if native is None else native.Rises(kernel).at
    return tree_bound(kernel, order, until, rises=rises)


def _exhausted(
    kernel: Kernel, walks: Walks, values: Values, end: float
) -> tuple[Ints | None, Values]:
    """The result of `prove`, and the best values; a longer memory first, where that may help."""
    cost = walks.known.cost
    if fits(kernel, walks.known, _LONG_MEMORY):
        now = time.perf_counter()
        longer = Walks(kernel, walks.known, _LONG_MEMORY, _NEAREST)
        until = now + (end - now) * _ON_PRICES
        found = raise_prices(longer, cost, until, 1000, values)
        if found is not None and found.bound > values.bound:
            walks, values = longer, found
    if values.bound < cost * (1 - _HOPELESS):
        return None, values
    return prove(kernel, walks, values, end, cost), values
