"""A lower bound from walks that may come back: time-indexed, with a price on every place.

A walk of the model `single` pays w[j] x arrival at each place it visits and earns price[j]; it may
visit a place twice but not turn straight back. Each order is such a walk, so the cheapest walk plus
all prices is a lower bound, whatever the prices (Lagrange); prices go up where the walk comes too
seldom and down where it comes too often. Legs are rounded down to whole steps of time, which can
only make walks cheaper (Abeledo et al. 2013 index by position; weights that differ need time).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.segments import Array

_BIG = 1e30
#: steps without a better bound after which steps become shorter
_PATIENCE, _SHORTER = 4, 0.6
#: how much longer than a known order a walk may take before it is only bounded
_HORIZON = 1.3
#: below this share of a full step prices stay where they are
_LEAST_SCALE = 0.01
_MOST_STEPS = 5000


@dataclass(frozen=True, slots=True, eq=False)
class Walks:
    """The cheapest way on from every place at every time."""

    onward: Array  # (steps + 1, m + 1) least cost from there on, less prices; last row: later
    price: Array  # (m,)
    step: float  # [s]
    bound: float  # of every order's cost
    seconds: float  # [s] it took to work out

    def at(self, seconds: Array, place: NDArray[np.intp]) -> Array:
        """`onward` (k,) at `seconds` (k,) in `place` (k,)."""
        row = np.minimum((seconds / self.step).astype(np.intp), len(self.onward) - 1)
        return self.onward[row, place]


class Grid:
    """The legs in whole steps, and the order in which times can be worked out at once."""

    def __init__(self, kernel: Kernel, horizon: float, step: float) -> None:
        m = kernel.size
        legs = np.floor(kernel.D / step * (1 - 1e-12)).astype(np.intp)
        legs[np.arange(m), np.arange(m)] = 0
        self.kernel, self.step = kernel, step
        off = ~np.eye(m + 1, m, dtype=bool)
        self.stride = int(legs[off].min())
        self.steps = int(horizon / step) + 1
        self.legs, self.self_ = legs, ~off
        self.rows = self.steps + int(legs.max()) + self.stride + 1

    def solve(self, price: Array) -> tuple[Walks, Array]:
        """The cheapest walk at `price` (m,), and 1 less how often it visits each place (m,)."""
        begin = time.perf_counter()
        m, steps = self.kernel.size, self.steps
        w = self.kernel.w
        pays = np.arange(self.rows)[:, None] * (self.step * w) - price
        late = -np.maximum(price - w * (steps * self.step), 0.0).sum()
        best = np.full((self.rows, m), late) + pays
        second = best.copy()
        after = np.full((self.rows, m), m + 1, dtype=np.intp)
        onward = np.full((steps + 1, m + 1), late)
        base = self.legs * m + np.arange(m)
        here = np.arange(m + 1)[:, None]
        for top in range(steps, 0, -self.stride):
            low = max(0, top - self.stride)
            where = base + np.arange(low, top)[:, None, None] * m
            cost = np.where(after.take(where) == here, second.take(where), best.take(where))
            cost[:, self.self_] = _BIG
            nearest = cost.argmin(axis=2)[..., None]
            one = np.take_along_axis(cost, nearest, 2)[..., 0]
            np.put_along_axis(cost, nearest, _BIG, 2)
            two = cost.min(axis=2)
            onward[low:top] = np.minimum(one, 0.0)
            best[low:top] = pays[low:top] + onward[low:top, :m]
            second[low:top] = pays[low:top] + np.minimum(two, 0.0)[:, :m]
            after[low:top] = np.where(one < 0, nearest[..., 0], m + 1)[:, :m]
        slope = 1.0 - self._trace(best, second, after)
        bound = float(price.sum() + onward[0, m])
        return Walks(onward, price, self.step, bound, time.perf_counter() - begin), slope

    def _trace(self, best: Array, second: Array, after: NDArray[np.intp]) -> Array:
        m = self.kernel.size
        visits = np.zeros(m)
        now, before, place = 0, -1, m
        while now < self.steps:
            rows = now + self.legs[place]
            columns = np.arange(m)
            cost = np.where(
                after[rows, columns] == place, second[rows, columns], best[rows, columns]
            )
            cost[self.self_[place]] = _BIG
            if 0 <= before < m:
                cost[before] = _BIG
            following = int(cost.argmin())
            if cost[following] >= 0:
                break
            now, before, place = int(rows[following]), place, following
            visits[place] += 1
        return visits


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What a known order tells: where to begin, and how long walks may get."""

    cost: float  # sum of first-find probability x arrival [s]
    total: float  # [s] until its last place is looked over
    price: Array  # (m,) probability x arrival: what each place costs in it

    @classmethod
    def of(cls, kernel: Kernel, order: Ints) -> Known:
        """What `order` (m,) tells."""
        legs = np.append(kernel.D[kernel.root, order[:1]], kernel.D[order[:-1], order[1:]])
        arrival = np.empty(len(order))
        arrival[order] = np.cumsum(legs)
        return cls(kernel.cost(order), float(legs.sum()), kernel.w * arrival)


def coarsest_step(kernel: Kernel, total: float) -> float | None:
    """A third of the shortest leg [s]; None where that makes too many steps of `total` seconds."""
    legs = kernel.D[~np.eye(kernel.size + 1, kernel.size, dtype=bool)]
    step = float(legs.min()) / 3.01
    return step if step > 0 and total * _HORIZON / step < _MOST_STEPS else None


def raise_prices(kernel: Kernel, known: Known, price: Array, step: float, deadline: float) -> Walks:
    """The best bound found from `price` (m,) until `deadline` (of time.perf_counter)."""
    grid = Grid(kernel, known.total * _HORIZON, step)
    weight = np.sqrt(known.price)
    best, slope = grid.solve(price)
    at, scale, since, drift = price, 1.0, 0, np.zeros(kernel.size)
    walks = best
    while time.perf_counter() < deadline and slope.any() and scale > _LEAST_SCALE:
        drift = 0.6 * drift + 0.4 * weight * slope
        reach = max(known.cost - walks.bound, 1e-3 * known.cost)
        at = at + drift * (scale * reach / max(float(slope @ (weight * slope)), 1e-12))
        walks, slope = grid.solve(at)
        since += 1
        if walks.bound > best.bound + 1e-6 * abs(best.bound):
            best, since = walks, 0
        elif since >= _PATIENCE:
            scale, since, at, drift = scale * _SHORTER, 0, best.price, np.zeros(kernel.size)
    return best
