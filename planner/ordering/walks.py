"""A lower bound from walks that may come back, with a price on every place.

A walk pays a[j] x phi(arrival) at each place it visits (`tangent`) and earns price[j]; it may visit
a place again, but not soon (`steps`). Each order is such a walk, so the cheapest walk plus all
prices is a lower bound, whatever the prices (Lagrange). Time is continuous: what a walk onward costs
at least is, for each way of going on, a concave function of the time it begins, so the least of them
is concave as well, and between two rows of a time grid it is not below the line that joins them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.steps import Array, Leap, Steps
from planner.ordering.tangent import Tangent

#: how much longer than a known order a walk may take before it is only bounded
_HORIZON = 1.15
#: a share of a walk too small to follow
_FAINT = 1e-9
#: rows after which the clock is looked at
_LOOK_UP = 16
#: most numbers in a table of values
_MOST = 40_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """What walks cost at least, at one choice of prices."""

    price: Array  # (m,)
    arrive: Array  # (rows, states) from arriving there on, what is paid and earned there included
    far: Array  # (blocks, m) from leaving there for a far place on
    bound: float  # of every order's cost


class Walks:
    """Walks on the time grid of a kernel and a known order."""

    def __init__(self, kernel: Kernel, known: Tangent, memory: int, nearest: int) -> None:
        m = kernel.size
        legs = kernel.D[~np.eye(m + 1, m, dtype=bool)]
        #: [s] between two rows: no leg is shorter
        self.step = float(legs.min()) * (1 - 1e-9)
        self.known, self.steps = known, Steps(kernel, self.step, memory, nearest)
        self.rows = int(known.total * _HORIZON / self.step) + 1
        self.height = self.rows + self.steps.longest + self.steps.block + 1
        self.phi = known.phi(np.arange(self.height) * self.step)

    def solve(self, price: Array, deadline: float = np.inf) -> Values | None:
        """The cheapest walks at `price` (m,); None where that takes longer than `deadline`."""
        steps, known, rows = self.steps, self.known, self.rows
        pays = self.phi[:, None] * known.a - price
        # beyond the grid a walk is given all that it could still earn
        late = -float(np.maximum(price - known.a * self.phi[rows], 0.0).sum())
        arrive = np.full((self.height, steps.states), late)
        far = np.full((-(-rows // steps.block) + 1, len(price)), late)
        values = Values(price, arrive, far, -np.inf)
        room = _rooms(steps.near), _rooms(steps.far)
        for row in range(rows - 1, -1, -1):
            if row % _LOOK_UP == 0 and time.perf_counter() > deadline:
                return None
            onward = _cost(arrive, steps.near, row, room[0]).min(axis=0)
            onward = np.minimum(onward, 0.0).reshape(-1, steps.memories)
            if steps.far is not None:
                block, place = divmod(row, steps.block)
                if place == steps.block - 1 or row == rows - 1:
                    far[block] = _cost(arrive, steps.far, row - place, room[1]).min(axis=0)
                onward = np.minimum(onward, self._far(values, row)[:, None])
            arrive[row] = (onward + pays[row][:, None]).ravel()
        start = float(_cost(arrive, steps.first, 0).min())
        bound = known.base + float(price.sum()) + min(start, 0.0)
        return Values(price, arrive, far, bound)

    def _far(self, values: Values, row: int) -> Array:
        """(m,) least cost of going on to a far place; concave, so a line bounds it in a block."""
        block, place = divmod(row, self.steps.block)
        share = place / self.steps.block
        return values.far[block] * (1 - share) + values.far[block + 1] * share

    def visits(self, values: Values) -> Array:
        """(m,) how often the cheapest walk visits each place, on average over its branches."""
        steps, block = self.steps, self.steps.block
        at = np.zeros((self.height, steps.states))
        away = np.zeros(values.far.shape)
        visits = np.zeros(len(values.price))
        self._go(values, steps.first, 0, np.ones(1), at, visits)
        for row in range(self.rows):
            here = np.flatnonzero(at[row] > _FAINT)
            if len(here):
                share = at[row, here]
                left = self._near_or_far(values, row, here, share, at, visits)
                if steps.far is not None:
                    part = (row % block) / block
                    went = np.bincount(steps.place[here], left, len(visits))
                    away[row // block] += went * (1 - part)
                    away[row // block + 1] += went * part
            if steps.far is not None and row % block == block - 1:
                gone = np.flatnonzero(away[row // block] > _FAINT)
                if len(gone):
                    leap, share = steps.far[gone], away[row // block, gone]
                    self._go(values, leap, row - block + 1, share, at, visits)
        return visits

    def _near_or_far(
        self, values: Values, row: int, here: Ints, share: Array, at: Array, visits: Array
    ) -> Array:
        """Take the near steps that are best; return what goes far, of each `share`."""
        leap = self.steps.near[here]
        near = _cost(values.arrive, leap, row).min(axis=0)
        far = np.zeros_like(near)
        if self.steps.far is not None:
            far = np.minimum(self._far(values, row)[self.steps.place[here]], 0.0)
        stays = near < np.minimum(far, 0.0)
        if stays.any():
            self._go(values, leap[np.flatnonzero(stays)], row, share[stays], at, visits)
        return np.where(stays | (far >= 0), 0.0, share)

    def _go(
        self, values: Values, leap: Leap, row: int, share: Array, at: Array, visits: Array
    ) -> None:
        """Take the best step of each column, unless none earns anything."""
        cost = _cost(values.arrive, leap, row)
        best = cost.argmin(axis=0)
        n = np.arange(len(best))
        good = np.flatnonzero(cost[best, n] < 0)
        best, n, share = best[good], n[good], share[good]
        visits += np.bincount(leap.place[best, n], share, len(visits))
        state, part = leap.state[best, n], leap.part[best, n]
        to = row + leap.rows[best, n]
        np.add.at(at, (to, state), share * (1 - part))
        np.add.at(at, (to + 1, state), share * part)

    def onward(self, values: Values, seconds: Array, state: Ints) -> Array:
        """(k,) what is at least paid and earned after `seconds` (k,) in `state` (k,)."""
        q = seconds / self.step
        row = np.minimum(q.astype(np.intp), self.rows)
        part = np.where(row < self.rows, q - row, 0.0)
        place = self.steps.place[state]
        a, price = self.known.a[place], values.price[place]
        low, high = (
            values.arrive[at, state] - np.where(at < self.rows, a * self.phi[at] - price, 0.0)
            for at in (row, row + 1)
        )
        found: Array = low + (high - low) * part
        return found


def fits(kernel: Kernel, known: Tangent, memory: int) -> bool:
    """Whether the table of values of such walks is small enough."""
    legs = kernel.D[~np.eye(kernel.size + 1, kernel.size, dtype=bool)]
    step, longest = float(legs.min()), float(legs.max())
    size = (known.total * _HORIZON + longest) * (kernel.size << memory)
    return step > 0 and size < _MOST * step


def raise_prices(walks: Walks, cost: float, deadline: float, most: int) -> Values | None:
    """The best bound found in `most` steps until `deadline` (of time.perf_counter), if any."""
    at = walks.known.marginal
    weight = np.abs(at) + 1e-6 * np.abs(at).max()
    found = best = walks.solve(at, deadline)
    scale, since, drift = 1.0, 0, np.zeros_like(at)
    for _ in range(most):
        if best is None or found is None or scale < _LEAST_SCALE:
            break
        slope = 1.0 - walks.visits(found)
        steep = float(slope @ (weight * slope))
        if steep < 1e-12 * weight.sum():
            break
        drift = 0.7 * drift + 0.3 * weight * slope
        at = at + drift * (scale * max(cost - found.bound, 1e-3 * cost) / steep)
        found = walks.solve(at, deadline)
        if found is None:
            break
        since += 1
        if found.bound > best.bound + 1e-6 * abs(best.bound):
            best, since = found, 0
        elif since >= _PATIENCE:
            scale, since, found, at = scale * _SHORTER, 0, best, best.price
            drift = np.zeros_like(at)
    return best


#: steps without a better bound after which steps become shorter
_PATIENCE, _SHORTER = 2, 0.7
#: below this share of a full step prices stay where they are
_LEAST_SCALE = 0.005


def _rooms(leap: Leap | None) -> tuple[Array, Array] | None:
    return None if leap is None else (np.empty(leap.part.shape), np.empty(leap.part.shape))


def _cost(arrive: Array, leap: Leap, row: int, room: tuple[Array, Array] | None = None) -> Array:
    """(k, n) value of each step of `leap` begun at `row`: on the line between two rows."""
    low, high = room or (np.empty(leap.part.shape), np.empty(leap.part.shape))
    arrive[row:].ravel().take(leap.index, out=low, mode="clip")
    arrive[row + 1 :].ravel().take(leap.index, out=high, mode="clip")
    high -= low
    high *= leap.part
    low += high
    low += leap.barred
    return low
