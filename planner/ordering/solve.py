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
#: share of the time spent on orders, by numpy; compiled; and of more places than clusters bound
_ON_ORDERS, _ON_COMPILED, _ON_MANY = 0.45, 0.4, 0.7
#: up to so many places clusters bound, as a step takes as long as the square of them; compiled
_TREES, _MANY_TREES = 700, 1500
#: up to so many places a proof by exhaustion is tried
_FEW = 40
#: share of the time spent on orders of that few, and on prices of what is left after that
_ON_FEW, _ON_PRICES = 0.25, 0.4
#: share of what is left after the orders for clusters, where walks come after them, and a proof
_ON_TREES, _ON_FIRST = 0.5, 0.08
#: up to so many places a second walks bound; they remember so many others, more before a proof
_WALKED, _MEMORY, _LONG_MEMORY = 45, 3, 6
#: where compiled walks are at hand: the share of the time spent on orders of places that may be
#: proven, and of what is left on clusters
_ON_PROVEN, _BEFORE_WALKS, _BEFORE_PROOF = 0.15, 0.15, 0.03
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
    if fast() is not None and kernel.size <= _MANY_TREES:
        return _compiled(kernel, end, seed)
    order = by_ratio(kernel)
    if kernel.size > MANY:
        bound = quick_bound(kernel)
        return improve(kernel, order, end, seed)[0], bound
    few = kernel.size <= _FEW
    share = _ON_FEW if few else _ON_ORDERS if kernel.size <= _TREES else _ON_MANY
    order, cost = improve(kernel, order, _part(end, share), seed)
    known = Tangent.of(kernel, order)
    if kernel.size > _WALKED * max(1.0, limit) or not fits(kernel, known, _MEMORY):
        return order, _without_walks(kernel, order, end)
    bound = _without_walks(kernel, order, _part(end, _ON_FIRST if few else _ON_TREES))
    walks = Walks(kernel, known, _MEMORY, _NEAREST)
    values = raise_prices(walks, cost, _part(end, _ON_PRICES if few else 1.0), 1000)
    if values is not None and few:
        better, values = _exhausted(kernel, walks, values, end)
        if better is not None:
            return (better if len(better) else order), np.inf
    return order, bound if values is None else max(bound, values.bound)


def _compiled(kernel: Kernel, end: float, seed: int) -> tuple[Ints, float]:
    """The order and the bound of what clusters bound, by compiled steps."""
    native = fast()
    assert native is not None, "loaded"
    walked = native.fits(kernel)
    share = _ON_PROVEN if walked else _ON_COMPILED
    order, _ = native.searched(kernel, _part(end, share), seed)
    if not walked:
        return order, _without_walks(kernel, order, end)
    share = _BEFORE_PROOF if kernel.size <= _FEW else _BEFORE_WALKS
    bound = _without_walks(kernel, order, _part(end, share))
    order, walked_bound = native.bounded(kernel, order, end)
    return order, max(bound, walked_bound)


def _part(end: float, share: float) -> float:
    """The end of a share of the time until `end`."""
    now = time.perf_counter()
    return now + (end - now) * share


def _without_walks(kernel: Kernel, order: Ints, until: float) -> float:
    """The bound of clusters, of split legs where places are many."""
    native = fast()
    if native is None and kernel.size > _TREES:
        return best_split(kernel, kernel.cost(order), until).bound
    rises = None if native is None else native.Rises(kernel).at
    return tree_bound(kernel, order, until, rises=rises)


def _exhausted(
    kernel: Kernel, walks: Walks, values: Values, end: float
) -> tuple[Ints | None, Values]:
    """The result of `prove`, and the best values; a longer memory first, where that may help."""
    cost = walks.known.cost
    if fits(kernel, walks.known, _LONG_MEMORY):
        longer = Walks(kernel, walks.known, _LONG_MEMORY, _NEAREST)
        until = _part(end, _ON_PRICES)
        found = raise_prices(longer, cost, until, 1000, values)
        if found is not None and found.bound > values.bound:
            walks, values = longer, found
    if values.bound < cost * (1 - _HOPELESS):
        return None, values
    return prove(kernel, walks, values, end, cost), values
