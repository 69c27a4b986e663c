"""A lower bound from walks that may come back, with a price on every place.

A walk pays a[j] x phi(arrival) at each place it visits (`tangent`) and earns price[j]; it may visit
a place again, but not soon (`steps`). Each order is such a walk, so the cheapest walk plus all
prices is a lower bound, whatever the prices (Lagrange). Time is continuous: what each way of going
on costs is a concave function of the time it begins, so the least of them is concave as well, and
between two rows of a time grid it is not below the line that joins them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.ordering.kernel import Ints, Kernel
from planner.ordering.steps import NEVER, Array, Leap, Steps
from planner.ordering.tangent import Tangent

#: how much longer than a known order a walk may take before it is only bounded
_HORIZON = 1.15
#: rows after which the clock is looked at
_LOOK_UP = 16
#: most numbers in a table of values
_MOST = 40_000_000
#: steps without a better bound after which steps become shorter
_PATIENCE, _SHORTER = 2, 0.7
#: the share of a full step to begin with at prices from less memory
_CLOSE = 0.5
#: below this share of a full step prices stay where they are
_LEAST_SCALE = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """What walks cost at least, at one choice of prices."""

    price: Array  # (m,)
    arrive: Array  # (rows, states) from arriving there on, what is paid and earned there included
    far: list[Array]  # for each ring (blocks, m): from leaving there for a place in it on
    bound: float  # of every order's cost


class _Flow(NamedTuple):
    """Where the cheapest walk goes: 1 where it comes through."""

    at: Array  # (rows, states)
    away: list[Array]  # for each ring (blocks, m): what sets out for it
    visits: Array  # (m,)


class Walks:
    """Walks on the time grid of a kernel and a known order."""

    def __init__(self, kernel: Kernel, known: Tangent, memory: int, nearest: int) -> None:
        m = kernel.size
        legs = kernel.D[~np.eye(m + 1, m, dtype=bool)]
        #: [s] between two rows: no leg is shorter
        self.step = float(legs.min()) * (1 - 1e-9)
        self.known, self.steps = known, Steps(kernel, self.step, memory, nearest)
        self.rows = int(known.total * _HORIZON / self.step) + 1
        blocks = [ring.block for ring in self.steps.far]
        self.height = self.rows + self.steps.longest + max(blocks, default=1) + 1
        self.phi = known.phi(np.arange(self.height) * self.step)

    def solve(self, price: Array, deadline: float = np.inf) -> Values | None:
        """The cheapest walks at `price` (m,); None where that takes longer than `deadline`."""
        steps, known, rows = self.steps, self.known, self.rows
        pays = self.phi[:, None] * known.a - price
        # beyond the grid a walk is given all that it could still earn
        late = -float(np.maximum(price - known.a * self.phi[rows], 0.0).sum())
        arrive = np.full((self.height, steps.states), late)
        far = [np.full((-(-rows // ring.block) + 1, len(price)), late) for ring in steps.far]
        values = Values(price, arrive, far, -np.inf)
        room, rooms = _room(steps.near), [_room(ring.leap) for ring in steps.far]
        for row in range(rows - 1, -1, -1):
            if row % _LOOK_UP == 0 and time.perf_counter() > deadline:
                return None
            for table, ring, space in zip(far, steps.far, rooms, strict=True):
                block, place = divmod(row, ring.block)
                if place == ring.block - 1 or row == rows - 1:
                    cost = _cost(arrive, ring.leap, row - place, space)
                    cost.min(axis=0, out=table[block])
            onward = _cost(arrive, steps.near, row, room).min(axis=0).reshape(-1, steps.memories)
            away = np.minimum(self._far(values, row).min(axis=0), 0.0)
            onward = np.minimum(onward, away[:, None])
            arrive[row] = (onward + pays[row][:, None]).ravel()
        start = float(_cost(arrive, steps.first, 0).min())
        bound = known.base + float(price.sum()) + min(start, 0.0)
        return Values(price, arrive, far, bound)

    def _far(self, values: Values, row: int) -> Array:
        """(rings + 1, m) cost of going on to each ring; concave, so a line bounds it in a block."""
        cost = np.full((len(values.far) + 1, len(values.price)), NEVER)
        for k, (table, ring) in enumerate(zip(values.far, self.steps.far, strict=True)):
            block, place = divmod(row, ring.block)
            share = place / ring.block
            cost[k] = (
                table[block] + (table[block + 1] - table[block]) * share if place else table[block]
            )
        return cost

    def visits(self, values: Values) -> Array:
        """(m,) how often the cheapest walk visits each place, about: its times rounded to rows.

        This steers the prices alone; a bound holds whatever they are.
        """
        rings = self.steps.far
        flow = _Flow(
            np.zeros((self.height, self.steps.states)),
            [np.zeros_like(table) for table in values.far],
            np.zeros(len(values.price)),
        )
        self._go(values, self.steps.first, 0, np.ones(1), flow)
        for row in range(self.rows):
            here = np.flatnonzero(flow.at[row])
            if len(here):
                self._leave(values, row, here, flow)
            for away, ring in zip(flow.away, rings, strict=True):
                block, place = divmod(row, ring.block)
                gone = np.flatnonzero(away[block])
                if place == ring.block - 1 and len(gone):
                    self._go(values, ring.leap[gone], row - place, away[block, gone], flow)
        return flow.visits

    def _leave(self, values: Values, row: int, here: Ints, flow: _Flow) -> None:
        """Take the near step that is best, or set out for the ring that is better."""
        share, leap, place = flow.at[row, here], self.steps.near[here], self.steps.place[here]
        near = _cost(values.arrive, leap, row).min(axis=0)
        far = self._far(values, row)[:, place]
        ring = far.argmin(axis=0)
        stays = near < far.min(axis=0)
        if stays.any():
            self._go(values, leap[np.flatnonzero(stays)], row, share[stays], flow)
        goes = ~stays & (far.min(axis=0) < 0)
        for k in np.unique(ring[goes]):
            block, part = divmod(row, self.steps.far[k].block)
            went = goes & (ring == k)
            out = np.bincount(place[went], share[went], len(flow.visits))
            flow.away[k][block + (part > self.steps.far[k].block / 2)] += out

    def _go(self, values: Values, leap: Leap, row: int, share: Array, flow: _Flow) -> None:
        """Take the best step of each column, unless none earns anything."""
        cost = _cost(values.arrive, leap, row)
        best = cost.argmin(axis=0)
        n = np.arange(len(best))
        good = np.flatnonzero(cost[best, n] < 0)
        best, n, share = best[good], n[good], share[good]
        flow.visits[:] += np.bincount(leap.place[best, n], share, len(flow.visits))
        state, part = leap.state[best, n], leap.part[best, n]
        to = row + leap.rows[best, n]
        np.add.at(flow.at, (to + (part > 0.5), state), share)

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


def raise_prices(
    walks: Walks, cost: float, deadline: float, most: int, start: Values | None = None
) -> Values | None:
    """The best bound found in `most` steps until `deadline` (of time.perf_counter), if any.

    `start` is what was found with less memory: its prices are a good beginning, not far off.
    """
    usual = walks.known.marginal
    weight = np.abs(usual) + 1e-6 * np.abs(usual).max()
    at = usual if start is None else start.price
    begin = time.perf_counter()
    found = best = walks.solve(at, deadline)
    took = time.perf_counter() - begin
    scale, since, drift = 1.0 if start is None else _CLOSE, 0, np.zeros_like(at)
    for _ in range(most):
        if best is None or found is None or scale < _LEAST_SCALE:
            break
        # not begun where it could not be ended: visits are not interrupted
        if time.perf_counter() + took > deadline:
            break
        begin = time.perf_counter()
        slope = 1.0 - walks.visits(found)
        steep = float(slope @ (weight * slope))
        if steep < 1e-12 * weight.sum():
            break
        drift = 0.7 * drift + 0.3 * weight * slope
        at = at + drift * (scale * max(cost - found.bound, 1e-3 * cost) / steep)
        found = walks.solve(at, deadline)
        if found is None:
            break
        took = time.perf_counter() - begin
        since += 1
        if found.bound > best.bound + 1e-6 * abs(best.bound):
            best, since = found, 0
        elif since >= _PATIENCE:
            scale, since, found, at = scale * _SHORTER, 0, best, best.price
            drift = np.zeros_like(at)
    return best


def _room(leap: Leap) -> tuple[Array, Array]:
    return np.empty(leap.part.shape), np.empty(leap.part.shape)


def _cost(arrive: Array, leap: Leap, row: int, room: tuple[Array, Array] | None = None) -> Array:
    """(k, n) value of each step of `leap` begun at `row`: on the line between two rows."""
    low, high = room or _room(leap)
    arrive[row:].ravel().take(leap.index, out=low, mode="clip")
    arrive[row + 1 :].ravel().take(leap.index, out=high, mode="clip")
    high -= low
    high *= leap.part
    low += high
    low += leap.barred
    return low
