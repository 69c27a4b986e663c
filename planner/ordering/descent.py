"""Moves made one by one from places that wait, until none gains anything; compiled.

Of all moves that make a leg from a waiting place to a place near it the best is made, if it gains
anything, and places at its ends wait in turn. Moves between long legs change in which order whole
corridors are taken. Orders and sums are as in `stretches`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.ordering.compiled import compiled
from planner.ordering.memories import Array, Whole
from planner.ordering.stretches import CHAIN, COST, LEFT, WHOLE, gain, make, renew

Flags = NDArray[np.bool_]
Seed = NDArray[np.uint64]
#: a gain must exceed this share of the cost: rounding must not make a search go in circles
LEAST = 1e-12
#: legs between which stretches are exchanged, and to which power of their length they are drawn
_CUTS, _DRAWN = 20, 1.5
#: moves that make one place follow another: exchanges, and two turns where that one is ahead
_BEHIND, _AHEAD = 4 * CHAIN, 4 * CHAIN + 2
#: positions after which less than this is left are not worth moving
_WORTH = 1e-9


@compiled("f8(u8[::1])")
def drawn_share(state: Seed) -> float:
    """The next number in 0..1, by splitmix64 (Steele, Lea, Flood 2014)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53


@compiled("f8(i8[::1],f8[:,::1],f8[:,::1],i8,i8,i8,i8,i8,f8,i8[::1])")
def _tried(
    place: Whole, sums: Array, legs: Array, i: int, c: int, j: int, turn: int, end: int,
    best: float, move: Whole,
) -> float:  # fmt: skip
    """`best`, or the gain of this move if it is more; then it is kept in `move`."""
    if i < 1 or c < i or j > end or (turn != WHOLE and c >= j) or i >= j:
        return best
    found = gain(place, sums, legs, i, c, j, turn)
    if found > best:
        move[0], move[1], move[2], move[3] = i, c, j, turn
        return found
    return best


@compiled("UniTuple(i8,4)(i8,i8,i8)")
def _move(u: int, v: int, n: int) -> tuple[int, int, int, int]:
    """Move number `n` of those that make the place at `v` follow the one at `u`."""
    long, kind = n // 4, n % 4
    if u < v:
        if long == CHAIN:
            return (u + 1, v, v, WHOLE) if kind == 0 else (u, v - 1, v - 1, WHOLE)
        if kind == 0:
            return u + 1, v - 1, v + long, 0  # the chain from v comes after u
        if kind == 1:
            return u + 1, v - long - 1, v, 1  # the chain up to v, turned, comes after u
        if kind == 2:
            return u - long, u, v - 1, 0  # the chain up to u comes before v
        return u, u + long, v - 1, 2  # the chain from u, turned, comes before v
    if kind == 0:
        return v, v + long, u, 0  # behind: the chain from v comes after u
    if kind == 1:
        return v - long, v, u, 2  # the chain up to v, turned, comes after u
    if kind == 2:
        return v, u - long - 1, u, 0  # the chain up to u comes before v
    return v, u - 1, u + long, 1  # the chain from u, turned, comes before v


@compiled("f8(i8,i8[::1],i8[::1],f8[:,::1],f8[:,::1],i8[:,::1],i8,f8,i8[::1])")
def _best_from(
    a: int, place: Whole, position: Whole, sums: Array, legs: Array, near_to: Whole, end: int,
    least: float, move: Whole,
) -> float:  # fmt: skip
    """The most that a move gains which makes a leg from place `a` to one near it."""
    u, best = position[a], least
    if u > end:
        return best
    for k in range(near_to.shape[1]):
        v = position[near_to[a, k]]
        if v > end or v == u + 1:
            continue
        for n in range(_AHEAD if u < v else _BEHIND):
            i, c, j, turn = _move(u, v, n)
            best = _tried(place, sums, legs, i, c, j, turn, end, best, move)
    return best


@compiled("i8[::1](i8[::1],f8[:,::1],i8,u8[::1])")
def draw_cuts(place: Whole, legs: Array, end: int, state: Seed) -> Whole:
    """Rising positions of legs drawn by their length, before which the order may be cut."""
    count = min(_CUTS, end)
    cuts, drawn = np.zeros(count, dtype=np.int64), np.full(count, np.inf)
    for k in range(1, end + 1):
        value = (
            -np.log(1.0 - drawn_share(state)) / max(legs[place[k - 1], place[k]], 1e-9) ** _DRAWN
        )
        at = count - 1
        if value < drawn[at]:
            while at > 0 and drawn[at - 1] > value:
                drawn[at], cuts[at] = drawn[at - 1], cuts[at - 1]
                at -= 1
            drawn[at], cuts[at] = value, k
    for k in range(1, count):
        cut, at = cuts[k], k
        while at > 0 and cuts[at - 1] > cut:
            cuts[at] = cuts[at - 1]
            at -= 1
        cuts[at] = cut
    return cuts


@compiled("f8(i8[::1],i8[::1],f8[:,::1],f8[:,::1],i8,f8,i8[::1])")
def best_cut(
    place: Whole, cuts: Whole, sums: Array, legs: Array, end: int, least: float, move: Whole
) -> float:
    """The most that an exchange or turn gains between some of `cuts`."""
    best = least
    for x in range(len(cuts)):
        for z in range(x + 1, len(cuts)):
            i, j = cuts[x], cuts[z] - 1
            best = _tried(place, sums, legs, i, j, j, WHOLE, end, best, move)
            for y in range(x + 1, z):
                for turn in range(4):
                    best = _tried(place, sums, legs, i, cuts[y] - 1, j, turn, end, best, move)
    return best


@compiled("void(i8,i8[::1],i8[::1],b1[::1],i8[::1])")
def wait(at: int, place: Whole, queue: Whole, waits: Flags, ends: Whole) -> None:
    """Let the place at a position wait, last in the ring that begins at ends[0], ends[1] long."""
    at = max(0, min(at, len(queue) - 1))
    a = place[at]
    if not waits[a]:
        waits[a] = True
        queue[(ends[0] + ends[1]) % len(queue)] = a
        ends[1] += 1


@compiled("void(i8[::1],i8[::1],i8[::1],b1[::1],i8[::1])")
def ends_wait(move: Whole, place: Whole, queue: Whole, waits: Flags, ends: Whole) -> None:
    """Let places wait where a move has made or may make new legs."""
    i, c, j = move[0], move[1], move[2]
    middle = i + j - c
    for at in (i - 1, i, c, c + 1, middle - 1, middle, j, j + 1):
        wait(at, place, queue, waits, ends)


@compiled("b1(i8[::1],i8[::1],i8[::1],f8[:,::1],f8[:,::1],f8[::1],f8[::1],i8[::1])")
def made(
    move: Whole, place: Whole, position: Whole, sums: Array, legs: Array, w: Array, keep: Array,
    room: Whole,
) -> bool:  # fmt: skip
    """Make a move that should gain something; whether it did, else it is undone."""
    m, i, j = len(w), move[0], move[2]
    cost = sums[COST, m]
    make(place, i, move[1], j, move[3], room)
    renew(place, position, sums, legs, w, keep, i)
    if sums[COST, m] < cost:
        return True
    place[i : j + 1] = room[i : j + 1]
    renew(place, position, sums, legs, w, keep, i)
    return False


@compiled("i8(f8[:,::1],i8)")
def last_worth(sums: Array, m: int) -> int:
    """The last position worth moving."""
    low, high = 0, m
    while low < high:
        at = (low + high + 1) // 2
        if sums[LEFT, at - 1] > _WORTH:
            low = at
        else:
            high = at - 1
    return low


@compiled(
    "void(i8[::1],i8[::1],f8[:,::1],f8[:,::1],f8[::1],f8[::1],i8[:,::1],i8[::1],b1[::1],i8[::1],"
    "i8[::1],i8[::1],i8)"
)
def descend(
    place: Whole, position: Whole, sums: Array, legs: Array, w: Array, keep: Array, near_to: Whole,
    queue: Whole, waits: Flags, ends: Whole, move: Whole, room: Whole, most: int,
) -> None:  # fmt: skip
    """Make moves from `most` places that wait, or until none waits; `room` (m + 2,) is for them."""
    m = len(w)
    end = last_worth(sums, m)
    for _ in range(most):
        if ends[1] == 0:
            break
        a = queue[ends[0]]
        ends[0] = (ends[0] + 1) % len(queue)
        ends[1] -= 1
        waits[a] = False
        least = LEAST * sums[COST, m]
        found = _best_from(a, place, position, sums, legs, near_to, end, least, move)
        if found > least and made(move, place, position, sums, legs, w, keep, room):
            end = last_worth(sums, m)
            ends_wait(move, place, queue, waits, ends)
            wait(position[a], place, queue, waits, ends)
