"""Moves on an order priced in O(1) each, compiled: as `segments` and `moves`, one move at a time.

An order is `place` (m + 2,), position 0 and m + 1 being m, the start and the end, and `sums`
(7, m + 2), its prefix sums by position, in rows as named below. `legs` (m + 1, m + 1) has the start
as its last row; its last column is 0, for no leg leads to the end.
"""

from __future__ import annotations

from planner.ordering.compiled import compiled
from planner.ordering.memories import Array, Whole

#: rows of the sums: share of the probability left, its inverse, seconds forth and back, probability
#: found, that x arrival, and for stretches that are turned weight over what is left, that x back
LEFT, SHARE, FORTH, BACK, FOUND, COST, OVER, OVER_BACK = range(8)
ROWS = 8
#: how moves make a new stretch of positions i..j: turned as a whole, else i..c and c + 1..j
#: exchanged, bit 0 turning the part that comes to stand first, bit 1 the second
WHOLE = -1
#: longest chain of places that is moved as one
CHAIN = 3


@compiled("void(i8[::1],i8[::1],f8[:,::1],f8[:,::1],f8[::1],f8[::1],i8)")
def renew(
    place: Whole, position: Whole, sums: Array, legs: Array, w: Array, keep: Array, first: int
) -> None:
    """Bring sums and positions up to date from position `first` (1 or more) on."""
    m = len(w)
    if first == 1:
        sums[:, 0] = 0.0
        sums[LEFT, 0] = sums[SHARE, 0] = 1.0
    for k in range(first, m + 1):
        a, b = place[k - 1], place[k]
        position[b] = k
        before = sums[LEFT, k - 1]
        left = before * keep[b]
        found = w[b] * before
        over = w[b] / max(left, 1e-300)
        sums[LEFT, k], sums[SHARE, k] = left, 1.0 / max(left, 1e-300)
        sums[FORTH, k] = sums[FORTH, k - 1] + legs[a, b]
        sums[BACK, k] = sums[BACK, k - 1] + (legs[b, a] if k > 1 else 0.0)
        sums[FOUND, k] = sums[FOUND, k - 1] + found
        sums[COST, k] = sums[COST, k - 1] + found * sums[FORTH, k]
        sums[OVER, k] = sums[OVER, k - 1] + over
        sums[OVER_BACK, k] = sums[OVER_BACK, k - 1] + over * sums[BACK, k]


@compiled("Tuple((f8,f8,f8,f8))(f8[:,::1],i8,i8,b1)")
def _stretch(sums: Array, i: int, j: int, turned: bool) -> tuple[float, float, float, float]:
    """Seconds, cost, probability found and share left of positions i..j, perhaps turned round."""
    share = sums[SHARE, i - 1]
    found = sums[FOUND, j] - sums[FOUND, i - 1]
    left = sums[LEFT, j]
    if turned:
        cost = sums[BACK, j] * (sums[OVER, j] - sums[OVER, i - 1])
        cost -= sums[OVER_BACK, j] - sums[OVER_BACK, i - 1]
        return sums[BACK, j] - sums[BACK, i], cost * left, found * share, left * share
    cost = sums[COST, j] - sums[COST, i - 1] - sums[FORTH, i] * found
    return sums[FORTH, j] - sums[FORTH, i], cost * share, found * share, left * share


@compiled("f8(i8[::1],f8[:,::1],f8[:,::1],i8,i8,i8,i8)")
def gain(place: Whole, sums: Array, legs: Array, i: int, c: int, j: int, turn: int) -> float:
    """What the order's cost falls by with a move."""
    m = len(place) - 2
    if turn == WHOLE:
        first, last = place[j], place[i]
        time, cost, _, _ = _stretch(sums, i, j, True)
    else:
        t1, c1, _f1, l1 = _stretch(sums, c + 1, j, turn & 1 > 0)
        t2, c2, f2, _ = _stretch(sums, i, c, turn & 2 > 0)
        first, end = (place[j], place[c + 1]) if turn & 1 else (place[c + 1], place[j])
        begin, last = (place[c], place[i]) if turn & 2 else (place[i], place[c])
        until = t1 + legs[end, begin]
        time, cost = until + t2, c1 + l1 * (f2 * until + c2)
    old_time, old_cost, found, _ = _stretch(sums, i, j, False)
    nearer = legs[place[i - 1], place[i]] - legs[place[i - 1], first]
    shorter = nearer + old_time - time + legs[place[j], place[j + 1]] - legs[last, place[j + 1]]
    inside = found * nearer + old_cost - cost
    gained: float = sums[LEFT, i - 1] * inside + shorter * (sums[FOUND, m] - sums[FOUND, j])
    return gained


@compiled("void(i8[::1],i8,i8,i8,i8,i8[::1])")
def make(place: Whole, i: int, c: int, j: int, turn: int, room: Whole) -> None:
    """Make a move on `place`; `room` (m + 2,) is for what is moved."""
    room[i : j + 1] = place[i : j + 1]
    if turn == WHOLE:
        for k in range(i, j + 1):
            place[k] = room[i + j - k]
        return
    for k in range(j - c):
        place[i + k] = room[j - k] if turn & 1 else room[c + 1 + k]
    begin = i + j - c
    for k in range(c - i + 1):
        place[begin + k] = room[c - k] if turn & 2 else room[i + k]
