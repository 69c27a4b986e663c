"""Bounds and proofs with compiled steps; loaded by `compiled.warm_up` alone."""

from __future__ import annotations

import time

import numpy as np

from planner.ordering import shares, timed
from planner.ordering.ascent import Prices, ascend
from planner.ordering.exhaust import MOST_PLACES, exhaust
from planner.ordering.kernel import Ints, Kernel
from planner.ordering.memories import Array, Memories
from planner.ordering.shares import ShareWalks
from planner.ordering.tangent import Tangent
from planner.ordering.timed import TimedWalks

__all__ = ["MOST_PLACES", "bounded"]

#: few places: what walks in time remember, and the share of the time left for their prices
_TIMED_MEMORY, _ON_TIMED = 4, 0.15
#: then rounds: memory, and the shares of what is left then for prices and for exhaustion
_ROUNDS = ((4, 0.3, 0.3), (6, 0.4, 0.5), (8, 0.5, 1.0))
#: share of the cost that counting in units may lose
_LOSS = 0.01
#: steps end at this share of a full one before a proof is tried
_SHORT = 0.04
#: many places: what walks remember first, for a share of the time, and what they may afterwards
_FIRST_MEMORY, _ON_FIRST, _MEMORIES = 1, 0.3, (5, 4, 3, 2)
#: tables of values that prices need, of few places and of many; where there is no time for so many
#: that remember so much, clusters bound better
_FEW_STEPS, _STEPS, _WORTH_MEMORY = 12, 20, 3
#: the share of a full step to begin with at prices of less memory
_CLOSE = 0.5


def worth_it(kernel: Kernel, order: Ints, seconds: float) -> bool:
    """Whether there is time in `seconds` for walks, near an `order` (m,) of about the right length.

    Without it clusters bound better (`trees`).
    """
    if timed.shortest(kernel) <= 0:
        return False
    table = timed.seconds_a_table(kernel, Tangent.of(kernel, order), _WORTH_MEMORY)
    return kernel.size <= MOST_PLACES or 2 * _STEPS * table < seconds


def bounded(kernel: Kernel, order: Ints, end: float) -> tuple[Ints, float]:
    """`order` (m,) or a better one, and what every order costs at least; infinite where proven.

    Until `end` (of time.perf_counter); for what is `worth_it`.
    """
    known = Tangent.of(kernel, order)
    if kernel.size <= MOST_PLACES:
        return _few(kernel, known, order, end)
    return order, _many(kernel, known, end)


def _few(kernel: Kernel, known: Tangent, order: Ints, end: float) -> tuple[Ints, float]:
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
        if _steps(shares.seconds_a_table(kernel.size, memory, units), end) < _FEW_STEPS:
            break
        share_walks = ShareWalks(kernel, known, Memories.nearest(kernel, memory), units)
        until = _part(end, on_prices)
        prices = ascend(
            share_walks, prices.price, weight, known.cost, until, scale=_CLOSE, least=_SHORT
        )
        best = max(best, share_walks.bound(prices.price))
        next_table = shares.seconds_a_table(kernel.size, memory + 2, units)
        if _steps(next_table, end) * (1.0 - on_proof) < _FEW_STEPS:
            on_proof = 1.0  # nothing could come after it
        found = exhaust(share_walks, prices.price, known.cost, _part(end, on_proof))
        if found is not None:
            return (found if len(found) else order), np.inf
    return order, best


def _many(kernel: Kernel, known: Tangent, end: float) -> float:
    """The bound of walks that first remember little, then as much as there is time for."""
    walks = TimedWalks(kernel, known, Memories.nearest(kernel, _FIRST_MEMORY))
    until, weight = _part(end, _ON_FIRST), _weight(known)
    prices = ascend(walks, known.marginal, weight, known.cost, until)
    for memory in _MEMORIES:
        if _steps(timed.seconds_a_table(kernel, known, memory), end) > _STEPS:
            walks = TimedWalks(kernel, known, Memories.nearest(kernel, memory))
            longer = ascend(walks, prices.price, weight, known.cost, end, scale=_CLOSE)
            return max(prices.bound, longer.bound)
    return prices.bound


def _weight(known: Tangent) -> Array:
    usual = np.abs(known.marginal)
    return usual + 1e-6 * float(usual.max())


def _part(end: float, share: float) -> float:
    now = time.perf_counter()
    return now + (end - now) * share


def _steps(seconds: float, end: float) -> float:
    """How many tables of so many `seconds` can be made until `end`."""
    return (end - time.perf_counter()) / seconds if seconds > 0 else np.inf
