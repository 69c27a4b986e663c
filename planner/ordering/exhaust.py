"""Proof by exhaustion, compiled: as `prove`, with the bound of walks that count what is left.

Sets of places that could still lead to a better order are kept, layer by layer, in a hash table by
set and last place, the cheapest way to each; a way is dropped where what it has cost and what the
walks of `shares` cost onward, remembering which of its places it has come through, come to no less
than the best order known.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from planner.ordering.compiled import compiled
from planner.ordering.kernel import Ints
from planner.ordering.memories import Array, States, Whole
from planner.ordering.shares import ShareWalks

#: most places: a set is the bits of one number
MOST_PLACES = 62
#: most ways at once, and ways followed between two looks at the clock
_MOST_WAYS, _AT_ONCE = 1 << 20, 2048
#: room for so many ways to begin with
_ROOM = 1 << 14
#: share of a known cost that a better order must save: rounding must not make one
_LEAST = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """Ways to begin an order; fields (room,)."""

    visited: Whole  # the places visited, one bit each
    last: Whole
    cost: Array  # legs x what was left before their end
    left: Array  # probability of a first find after them
    price: Array  # of the places not visited
    units: Whole  # of the same
    parent: Whole  # which way of the layer before

    @classmethod
    def room(cls, size: int) -> _Ways:
        """So many ways, not filled in."""
        whole = [np.empty(size, dtype=np.int64) for _ in range(4)]
        real = [np.empty(size) for _ in range(3)]
        return cls(whole[0], whole[1], real[0], real[1], real[2], whole[2], whole[3])


def exhaust(walks: ShareWalks, price: Array, cost: float, deadline: float) -> Ints | None:
    """The optimal order (m,), an empty one where none beats `cost`; None without a proof in time.

    `price` (m,) are those the walks were last solved at, `deadline` is of time.perf_counter. For
    up to MOST_PLACES places.
    """
    m = walks.kernel.size
    start = _Ways.room(1)
    start.visited[0], start.last[0], start.cost[0], start.parent[0] = 0, m, 0.0, 0
    start.left[0], start.price[0] = walks.kernel.norm, float(price.sum())
    start.units[0] = len(walks.left) - 1
    if walks.kernel.any:
        start.left[0] = 1.0 - float(np.prod(1.0 - walks.kernel.w))
    layers, count = [(start.last, start.parent)], 1
    ways = start
    for _ in range(m):
        found = _layer(walks, price, cost, deadline, ways, count)
        if found is None:
            return None
        ways, count = found
        if not count:
            return np.empty(0, dtype=np.intp)
        layers.append((ways.last[:count].copy(), ways.parent[:count].copy()))
    return _trace(layers, int(np.argmin(ways.cost[:count])))


def _layer(
    walks: ShareWalks, price: Array, cost: float, deadline: float, ways: _Ways, count: int
) -> tuple[_Ways, int] | None:
    """All ways one place longer that may lead to less than `cost`, and how many."""
    kernel, memories = walks.kernel, walks.memories
    beyond = float(np.prod(1.0 - kernel.w)) if kernel.any else 0.0
    most, room = cost * (1 - _LEAST) + walks.slack, _ROOM
    while room <= _MOST_WAYS:
        new, table, found = _Ways.room(room), np.full(2 * room, -1, dtype=np.int32), 0
        for low in range(0, count, _AT_ONCE):
            if time.perf_counter() > deadline:
                return None
            found = _expand(
                low, min(count, low + _AT_ONCE), ways.visited, ways.last, ways.cost, ways.left,
                ways.price, ways.units, walks.legs, kernel.w, kernel.any, beyond, walks.units,
                price, walks.onward, memories.first, memories.pointer, memories.remembered, most,
                new.visited, new.last, new.cost, new.left, new.price, new.units, new.parent,
                table, found,
            )  # fmt: skip
            if found < 0:
                break
        if found >= 0:
            return new, found
        room *= 4
    return None


def _trace(layers: list[tuple[Whole, Whole]], way: int) -> Ints:
    order = []
    for last, parent in reversed(layers[1:]):
        order.append(int(last[way]))
        way = int(parent[way])
    return np.array(order[::-1], dtype=np.intp)


@compiled(
    "i8(i8,i8,i8[::1],i8[::1],f8[::1],f8[::1],f8[::1],i8[::1],f8[:,::1],f8[::1],b1,f8,i8[::1],"
    "f8[::1],f8[:,::1],i8[::1],i8[::1],i8[::1],f8,"
    "i8[::1],i8[::1],f8[::1],f8[::1],f8[::1],i8[::1],i8[::1],i4[::1],i8)"
)
def _expand(
    low: int,
    high: int,
    visited: Whole,
    last: Whole,
    cost: Array,
    left: Array,
    price_left: Array,
    units_left: Whole,
    legs: Array,
    w: Array,
    some: bool,
    beyond: float,
    units: Whole,
    price: Array,
    onward: Array,
    first: Whole,
    pointer: Whole,
    remembered: Whole,
    most: float,
    new_visited: Whole,
    new_last: Whole,
    new_cost: Array,
    new_left: Array,
    new_price: Array,
    new_units: Whole,
    new_parent: Whole,
    table: States,
    found: int,
) -> int:
    """Add ways low..high - 1, each one place longer; how many there are then, -1 without room."""
    inside, room, one = len(table) - 1, len(new_last), np.int64(1)
    for way in range(low, high):
        for j in range(len(w)):
            been = visited[way]
            if (been >> j) & one:
                continue
            state = first[j]
            for p in range(pointer[j], pointer[j + 1]):
                state += ((been >> remembered[p]) & one) << (p - pointer[j])
            spent = cost[way] + legs[last[way], j] * left[way]
            prices, rest = price_left[way] - price[j], units_left[way] - units[j]
            if not spent + prices + onward[rest, state] < most:
                continue
            been |= one << j
            at = been * np.int64(-7046029254386353131) + j * np.int64(-4417276706812531889)
            at = (at ^ (at >> 29)) * np.int64(-4658895280553007687)
            at = (at ^ (at >> 32)) & inside
            while table[at] >= 0 and not (
                new_visited[table[at]] == been and new_last[table[at]] == j
            ):
                at = (at + 1) & inside
            k = np.int64(table[at])
            if k < 0:
                if found >= room:
                    return -1
                k, table[at] = np.int64(found), found
                found += 1
                new_visited[k], new_last[k], new_cost[k] = been, j, np.inf
                new_price[k], new_units[k] = prices, rest
                new_left[k] = (
                    (left[way] + beyond) * (1.0 - w[j]) - beyond if some else (left[way] - w[j])
                )
            if spent < new_cost[k]:
                new_cost[k], new_parent[k] = spent, way
    return found
