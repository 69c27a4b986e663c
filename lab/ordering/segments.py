"""Segments of an order, priced forwards or backwards in O(1) from prefix sums.

A segment is summarised by how long it takes, its cost counted from its first place, the probability
of a first find in it, and the share of the probability that is left after it (1 in the model
`single`). Two segments are concatenated by arithmetic on these alone (Silva et al. 2012 for the
travelling repairman; the surviving share extends it to the model `any`). All functions take arrays
of positions and so price many moves at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.ordering.reduction import Floats, Ints, ReducedProblem

Array = NDArray[np.float64]
#: greatest probability of a place in the model `any`, so that what is left can be divided by
_SUREST = 1.0 - 1e-9
#: positions after which less than this is left are not worth moving
_WORTH = 1e-9


class Segment(NamedTuple):
    """Consecutive places of an order; each field (k,) for k segments."""

    first: Ints
    last: Ints
    time: Array  # [s] from its first place to its last
    cost: Array  # [s] sum of first-find probability x time from its first place
    found: Array  # probability of a first find in it
    left: Array  # share left after it


class LegTimes(NamedTuple):
    """Leg times and probabilities of a reduced problem, laid out for moves."""

    flat: Floats  # ((m + 1) m,) [s] the leg matrix, row after row
    w: Array  # (m,)
    keep: Array  # (m,) share left after a look

    def __call__(self, a: Ints, b: Ints) -> Array:
        """Seconds from a to b, element by element; none to the end, which is place m."""
        m = len(self.w)
        return np.where(b < m, self.flat.take(a * m + np.minimum(b, m - 1)), 0.0)


def leg_times(reduced: ReducedProblem) -> LegTimes:
    """Leg times of `reduced`."""
    w = np.minimum(reduced.w, _SUREST) if reduced.any else reduced.w
    return LegTimes(reduced.D.ravel(), w, 1.0 - w if reduced.any else np.ones_like(w))


class PricedOrder:
    """Order of m places with its prefix sums; positions run from 1, 0 is the start."""

    __slots__ = (
        "_arrive", "_back", "_cost", "_found", "_left", "_u", "_ub", "cost", "end", "legs",
        "place", "position",
    )  # fmt: skip

    def __init__(self, legs: LegTimes, places: Ints) -> None:
        m = len(places)
        self.legs = legs
        self.place = np.empty(m + 2, dtype=np.intp)
        self.place[0] = self.place[-1] = m
        self.place[1:-1] = places
        self.position = np.empty(m + 1, dtype=np.intp)
        self.position[self.place[:-1]] = np.arange(m + 1)
        w, forth = legs.w[places], legs(self.place[:-2], places)
        back = legs(places, self.place[:-2])
        back[0] = 0.0
        self._left = _sums(np.cumprod(legs.keep[places]), 1.0)
        self._arrive, self._back = _sums(np.cumsum(forth)), _sums(np.cumsum(back))
        first = w * self._left[:-1]
        self._found = _sums(np.cumsum(first))
        self._cost = _sums(np.cumsum(first * self._arrive[1:]))
        self.cost = float(self._cost[-1])
        u = w / np.maximum(self._left[1:], 1e-300)
        self._u, self._ub = _sums(np.cumsum(u)), _sums(np.cumsum(u * self._back[1:]))
        #: the last position worth moving
        self.end = int(np.searchsorted(-self._left[:-1], -_WORTH))
        self.end = min(self.end, m)

    def forward(self, i: Ints, j: Ints) -> Segment:
        """Segments at positions i..j."""
        before, share = i - 1, 1.0 / self._left[i - 1]
        found = self._found[j] - self._found[before]
        cost = self._cost[j] - self._cost[before] - self._arrive[i] * found
        time = self._arrive[j] - self._arrive[i]
        first, last = self.place[i], self.place[j]
        return Segment(first, last, time, cost * share, found * share, self._left[j] * share)

    def backward(self, i: Ints, j: Ints) -> Segment:
        """Segments at positions i..j, reversed."""
        before, share = i - 1, 1.0 / self._left[i - 1]
        found = (self._found[j] - self._found[before]) * share
        cost = self._back[j] * (self._u[j] - self._u[before]) - (self._ub[j] - self._ub[before])
        first, last, time = self.place[j], self.place[i], self._back[j] - self._back[i]
        return Segment(first, last, time, cost * self._left[j], found, self._left[j] * share)

    def gain(self, i: Ints, j: Ints, instead: Segment) -> Array:
        """Decrease (k,) of the cost where positions i..j are replaced by `instead`."""
        old = self.forward(i, j)
        before, after = self.place[i - 1], self.place[j + 1]
        nearer = self.legs(before, old.first) - self.legs(before, instead.first)
        shorter = nearer + old.time - instead.time
        shorter += self.legs(old.last, after) - self.legs(instead.last, after)
        inside = old.found * nearer + old.cost - instead.cost
        gained: Array = self._left[i - 1] * inside + shorter * (self._found[-1] - self._found[j])
        return gained


def join(legs: LegTimes, a: Segment, b: Segment) -> Segment:
    """Concatenation: `a`, then `b`."""
    until = a.time + legs(a.last, b.first)
    cost = a.cost + a.left * (b.found * until + b.cost)
    found = a.found + a.left * b.found
    return Segment(a.first, b.last, until + b.time, cost, found, a.left * b.left)


def _sums(values: Floats, start: float = 0.0) -> Array:
    return np.concatenate([[start], values])
