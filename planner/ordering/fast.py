"""Orders, bounds and proofs with compiled steps; loaded by `compiled.warm_up` alone."""

from __future__ import annotations

import time

import numpy as np

from planner.ordering import shares, timed
from planner.ordering.ascent import Prices, ascend
from planner.ordering.exhaust import MOST_PLACES, exhaust
from planner.ordering.kernel import Ints, Kernel
from planner.ordering.memories import Array, Memories
from planner.ordering.rises import Rises
from planner.ordering.search import searched
from planner.ordering.shares import ShareWalks
from planner.ordering.tangent import Tangent
from planner.ordering.timed import TimedWalks

__all__ = ["Rises", "bounded", "fits", "searched"]

#: what walks in time remember, and the share of the time left for their prices
_TIMED_MEMORY, _ON_TIMED = 4, 0.15
#: then rounds: memory, and the shares of what is left then for prices and for exhaustion
_ROUNDS = ((4, 0.3, 0.3), (6, 0.4, 0.5), (8, 0.5, 1.0))
#: share of the cost that counting in units may lose
_LOSS = 0.01
#: steps end at this share of a full one before a proof is tried
_SHORT = 0.04
#: tables of values that prices need
_STEPS = 12
#: the share of a full step to begin with at prices of less memory
_CLOSE = 0.5


def fits(kernel: Kernel) -> bool:
    """Whether walks and proofs are for `kernel`; clusters bound more places better (`trees`)."""
    return kernel.size <= MOST_PLACES and timed.shortest(kernel) > 0


def bounded(kernel: Kernel, order: Ints, end: float) -> tuple[Ints, float]:
    """`order` (m,) or a better one, and what every order costs at least; infinite where proven.

    Until `end` (of time.perf_counter); for what `fits`.
    """
    known = Tangent.of(kernel, order)
    weight = _weight(known)
    prices, best = Prices(-np.inf, known.marginal), -np.inf
    if _steps(timed.seconds_a_table(kernel, known, _TIMED_MEMORY), end) > _STEPS:
        walks = TimedWalks(kernel, known, Memories.nearest(kernel, _TIMED_MEMORY))
        prices = ascend(
            walks, prices.price, weight, known.cost, _part(end, _ON_TIMED), least=_SHORT
        )
        best = prices.bound
    units = shares.units_for(kernel, order, known, _LOSS)
    for memory, on_prices, on_proof in _ROUNDS:
        if _steps(shares.seconds_a_table(kernel.size, memory, units), end) < _STEPS:
            break
        share_walks = ShareWalks(kernel, known, Memories.nearest(kernel, memory), units)
        until = _part(end, on_prices)
        prices = ascend(
            share_walks, prices.price, weight, known.cost, until, scale=_CLOSE, least=_SHORT
        )
        best = max(best, share_walks.bound(prices.price))
        next_table = shares.seconds_a_table(kernel.size, memory + 2, units)
        if _steps(next_table, end) * (1.0 - on_proof) < _STEPS:
            on_proof = 1.0  # nothing could come after it
        found = exhaust(share_walks, prices.price, known.cost, _part(end, on_proof))
        if found is not None:
            return (found if len(found) else order), np.inf
    return order, best


def _weight(known: Tangent) -> Array:
    usual = np.abs(known.marginal)
    return usual + 1e-6 * float(usual.max())


def _part(end: float, share: float) -> float:
    now = time.perf_counter()
    return now + (end - now) * share


def _steps(seconds: float, end: float) -> float:
    """How many tables of so many `seconds` can be made until `end`."""
    return (end - time.perf_counter()) / seconds if seconds > 0 else np.inf
