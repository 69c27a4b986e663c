"""What an order costs at least, as a sum over its places of a function of their arrivals alone.

`single`: the sum of w[j] x arrival[j] is the cost itself. `any`: the cost is the integral of the
probability S(t) = exp(-A(t)) left at t, A(t) the sum of a[j] = -log(1 - p[j]) over the places
looked over by t, less what is left at the end. exp is convex, so S(t) >= s(t) (1 + B(t) - A(t))
with B(t) the A(t) of a known order and s = exp(-B); integrated that is a constant plus the sum of
a[j] x phi(arrival[j]), phi(t) the integral of s up to t. At the known order both sides are equal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Floats, Ints, Kernel

Array = NDArray[np.float64]
#: in the model `any`: a surer place is taken to be this sure, which costs less than this x [s]
_SUREST = 1.0 - 1e-12
#: measured, as prices to begin with: how many times its delay a place is worth, up to so many
#: places; of many, walks come back to those far on, so their own share counts less, not below this
_DELAYED, _MANY, _OWN = 1.3, 85, 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Tangent:
    """cost(order) >= base + sum of a[j] x phi(arrival[j]); phi is concave and grows."""

    cost: float  # the known order's: sum of first-find probability x arrival [s]
    total: float  # [s] until its last place is looked over
    arrival: Array  # (m,) [s] when the known order has looked over each place
    marginal: Array  # (m,) prices to begin with: roughly what the order saves without each place
    a: Array  # (m,)
    base: float
    _times: Array  # (k,) [s] where phi bends
    _values: Array  # (k,) phi there
    _slopes: Array  # (k,) and its slope from there on

    def phi(self, seconds: Floats) -> Array:
        """`phi` at `seconds`, element by element."""
        at = np.clip(np.searchsorted(self._times, seconds, side="right") - 1, 0, None)
        value: Array = self._values[at] + (seconds - self._times[at]) * self._slopes[at]
        return value

    @classmethod
    def of(cls, kernel: Kernel, order: Ints) -> Tangent:
        """The tangent at `order` (m,)."""
        before = np.append(kernel.root, order[:-1])
        legs = kernel.D[before, order].astype(np.float64)
        ends = np.cumsum(legs)
        arrival = np.empty(len(order))
        arrival[order] = ends
        a, times, slopes, base = kernel.w, np.zeros(1), np.ones(1), 0.0
        if kernel.any:
            a = -np.log1p(-np.minimum(kernel.w, _SUREST))
            done = np.append(0.0, np.cumsum(a[order]))
            times, slopes = np.append(0.0, ends), np.exp(-done)
            left = slopes[:-1] * (1.0 + done[:-1] - done[-1]) - slopes[-1]
            base = float(legs @ left) - (1.0 - _SUREST) * float(ends[-1])
        values = np.append(0.0, np.cumsum(np.diff(times) * slopes[:-1]))
        cost = kernel.cost(order)
        total = float(ends[-1])
        bare = cls(cost, total, arrival, arrival, a, base, times, values, slopes)
        return replace(bare, marginal=bare._marginal(kernel, order))

    def _marginal(self, kernel: Kernel, order: Ints) -> Array:
        """Each place's own term, and what its detour delays the places after it."""
        before = np.append(kernel.root, order[:-1])
        detour = kernel.D[before, order].astype(np.float64)
        detour[:-1] += kernel.D[order[:-1], order[1:]] - kernel.D[before[:-1], order[1:]]
        detour[-1] = 0.0
        ends = self.arrival[order]
        slope = self._slopes[np.searchsorted(self._times, ends, side="left") - 1]
        growth = self.a[order] * slope
        after = growth.sum() - np.cumsum(growth)
        few = min(1.0, _MANY / len(order))
        marginal = self.a * self.phi(self.arrival) * max(few, _OWN)
        marginal[order] += (_DELAYED if few == 1.0 else 1.0) * detour * after
        return marginal
