"""A lower bound from walks that know what share of the probability is left, not what time it is.

An order's cost is the sum over its legs of leg x what is left before its end, and what is left
depends on the set looked over. Let every place have a whole number of units, about in proportion to
its weight (in `any` to -log(1 - p), whose sum tells what is left). Whatever set of places makes up
a number of units, at least so much is left: the least over all such sets, a knapsack. A walk that
comes to all units in the end and pays each leg by that, with a price on every place, is a
relaxation of all orders, as in `walks`; no grid rounds its cost, and in `any` no tangent stands in
for it. Position-indexed bounds of the travelling repairman (Picard, Queyranne 1978) are the case of
equal weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.ordering.compiled import compiled
from planner.ordering.kernel import Ints, Kernel
from planner.ordering.memories import Array, Memories, States, Whole
from planner.ordering.tangent import Tangent

#: in `any`: units of places surer than 1 - exp(-this) are those of one as sure
_SURE = 3.0
#: in `any`: what a certain place leaves, as `tangent` has it
_LEFT = 1e-12
#: how many units there may be in all
_UNITS = (250, 400, 600, 1000, 1500, 2500)
#: most numbers in a table of values
_MOST = 10_000_000
#: [s] a leg that must not be taken; values of 1e29 and more are of what cannot be
_BARRED = 1e230


class ShareWalks:
    """Walks that count units of probability, about `units` in all."""

    def __init__(self, kernel: Kernel, known: Tangent, memories: Memories, units: int) -> None:
        m = kernel.size
        self.kernel, self.memories = kernel, memories
        #: (m,); (units + 1,) what at least is left when so many are, below 0 where none are so many
        self.units, self.left = counted(kernel, known, units)
        total = len(self.left) - 1
        self.legs = np.ascontiguousarray(kernel.D, dtype=np.float64)
        self._onto = np.where(memories.free, self.legs[:m], _BARRED).T.copy()
        #: (units + 1, states) what is still paid and earned from there on
        self.onward = np.empty((total + 1, memories.states))
        #: a certain place leaves nothing: so much less may an order cost
        sure = kernel.any and bool((kernel.w > 1.0 - _LEFT).any())
        self.slack = _LEFT * float(self.legs.max(axis=0).sum()) if sure else 0.0
        self._price = np.zeros(m)

    def bound(self, price: Array) -> float:
        """The bound at `price` (m,)."""
        memories, m = self.memories, self.kernel.size
        self._price = price
        _backward(
            self.legs, self._onto, self.units, self.left, memories.bound, memories.to,
            memories.map, memories.after, memories.first, price, self.onward,
        )  # fmt: skip
        total = len(self.left) - 1
        after = self.onward[total - self.units, memories.first[:-1]]
        start = self.legs[m] * self.left[total] - price + after
        return float(price.sum()) + float(start.min()) - self.slack

    def visits(self, draw: int) -> Array:
        """(m,) visits of the walk that costs least; nothing is drawn."""
        memories = self.memories
        visits = np.zeros(self.kernel.size)
        _follow(
            self.legs, memories.free, self.units, self.left, memories.bound, memories.to,
            memories.map, memories.after, memories.first, self._price, self.onward, visits,
        )  # fmt: skip
        return visits


def units_for(kernel: Kernel, order: Ints, known: Tangent, loss: float) -> int:
    """So many units that counting them costs `order` (m,) at most a share of `loss` of its cost.

    Fewer lose more, as they tell weights less well apart; more take longer.
    """
    for units in _UNITS:
        sizes, left = counted(kernel, known, units)
        after = len(left) - 1 - np.append(0, np.cumsum(sizes[order])[:-1])
        legs = kernel.D[np.append(kernel.root, order[:-1]), order]
        if float(legs @ left[after]) >= (1.0 - loss) * known.cost:
            return units
    return _UNITS[-1]


def counted(kernel: Kernel, known: Tangent, units: int) -> tuple[Whole, Array]:
    """(m,) units of each place; what at least is left when so many are, below 0 where never."""
    a = known.a
    sized = np.minimum(a, _SURE) if kernel.any else a
    sizes = np.maximum(1, np.rint(sized / sized.sum() * units)).astype(np.int64)
    least = np.full(int(sizes.sum()) + 1, np.inf)
    _knapsack(sizes, a.astype(np.float64), least)
    left = np.exp(-a.sum()) * np.expm1(np.minimum(least, 700.0)) if kernel.any else least
    return sizes, np.where(np.isfinite(least), left, -1.0)


def seconds_a_table(size: int, memory: int, units: int) -> float:
    """[s] a table of values takes, about; infinity where it would be too large."""
    if units * (size << memory) > _MOST:
        return np.inf
    return units * (size**2 * 0.4 + (size << memory) * 2.0 * (memory + 2)) * 1.2e-9


@compiled("void(i8[::1],f8[::1],f8[::1])")
def _knapsack(units: Whole, weight: Array, least: Array) -> None:
    """The least weight of any set of so many units, infinite where there is none."""
    least[0] = 0.0
    for j in range(len(units)):
        for r in range(len(least) - 1, units[j] - 1, -1):
            least[r] = min(least[r], least[r - units[j]] + weight[j])


@compiled(
    "void(f8[:,::1],f8[:,::1],i8[::1],f8[::1],i8[::1],i8[::1],i8[::1],i4[::1],i8[::1],"
    "f8[::1],f8[:,::1])"
)
def _backward(  # noqa: C901 - one kernel: a call inside costs more than the loop
    legs: Array,
    onto: Array,
    units: Whole,
    left: Array,
    bound: Whole,
    to: Whole,
    maps: Whole,
    after: States,
    first: Whole,
    price: Array,
    onward: Array,
) -> None:
    """Fill `onward`; `onto` (m, m) are the free legs, by the place they lead to."""
    m = len(units)
    free, best = np.empty(m), np.empty(int(np.diff(first).max()))
    onward[0] = 0.0
    for r in range(1, len(left)):
        share = left[r]
        if share < 0.0:
            onward[r] = 1e30
            continue
        free[:] = 1e30
        weight = max(share, 1e-200)  # so that a leg of 1e230 is barred even where nothing is left
        for j in range(m):
            if units[j] > r:
                continue
            reached = onward[r - units[j], first[j]] - price[j]
            if reached < 1e29:
                for i in range(m):
                    free[i] = min(free[i], onto[j, i] * weight + reached)
        for i in range(m):
            begin = first[i]
            count = first[i + 1] - begin
            best[:count] = min(free[i], 1e30)
            for e in range(bound[i], bound[i + 1]):
                j = to[e]
                if units[j] > r:
                    continue
                pays = legs[i, j] * share - price[j]
                for s in range(count):
                    state = after[maps[e] + s]
                    if state >= 0:
                        best[s] = min(best[s], pays + onward[r - units[j], state])
            for s in range(count):
                onward[r, begin + s] = best[s]


@compiled(
    "void(f8[:,::1],b1[:,::1],i8[::1],f8[::1],i8[::1],i8[::1],i8[::1],i4[::1],i8[::1],"
    "f8[::1],f8[:,::1],f8[::1])"
)
def _follow(
    legs: Array,
    free: NDArray[np.bool_],
    units: Whole,
    left: Array,
    bound: Whole,
    to: Whole,
    maps: Whole,
    after: States,
    first: Whole,
    price: Array,
    onward: Array,
    visits: Array,
) -> None:
    """Count the visits (m,) of the cheapest walk."""
    m = len(units)
    i, s, r = m, 0, len(left) - 1
    while r > 0:
        least, best, best_state = 1e29, -1, np.int64(0)
        for j in range(m):
            if units[j] <= r and (i == m or free[i, j]):
                value = legs[i, j] * left[r] - price[j] + onward[r - units[j], first[j]]
                if value < least:
                    least, best, best_state = value, j, first[j]
        if i < m:
            for e in range(bound[i], bound[i + 1]):
                j = to[e]
                state = np.int64(after[maps[e] + s])
                if units[j] <= r and state >= 0:
                    value = legs[i, j] * left[r] - price[j] + onward[r - units[j], state]
                    if value < least:
                        least, best, best_state = value, j, state
        if best < 0:
            return
        visits[best] += 1.0
        r -= units[best]
        i, s = best, best_state - first[best]
