"""2-opt and or-opt moves, with or without reversal, priced many at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lab.ordering.reduction import Ints
from lab.ordering.segments import Array, PricedOrder, join

#: longest chain of places that is moved as one
CHAIN = 3


class Moves(NamedTuple):
    """Moves on positions i..j, cut after c, each field (k,).

    turn: -1 reverses i..j as a whole; else i..c and c+1..j are exchanged, and bit 0 reverses the
    part that becomes the first, bit 1 the one that becomes the second.
    """

    i: Ints
    c: Ints
    j: Ints
    turn: Ints
    gain: Array


def moves(order: PricedOrder, a: Ints, b: Ints) -> Moves:
    """Moves of the neighbourhood that create a leg from places `a` (k,) to `b` (k,)."""
    u, v = order.position[a], order.position[b]
    inside = (u <= order.end) & (v <= order.end) & (v != u + 1) & (v > 0)
    u, v = u[inside], v[inside]
    parts = [_turned(order, *where) for where in _turns(u, v)]
    kinds: dict[int, list[tuple[Ints, Ints, Ints]]] = {}
    for turn, i, c, j in _exchanges(u, v):
        fits = (i >= 1) & (i <= c) & (c < j) & (j <= order.end)
        kinds.setdefault(turn, []).append((i[fits], c[fits], j[fits]))
    for turn, found in kinds.items():
        i, c, j = (np.concatenate(each) for each in zip(*found, strict=True))
        parts.append(_exchanged(order, i, c, j, turn))
    return Moves(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def far_moves(order: PricedOrder, cuts: Ints) -> Moves:
    """Reversals and exchanges, reversed or not, of segments that begin or end at `cuts`.

    `cuts` (k,) are rising positions 1..end before which the order may be cut; about k^3 / 2 moves.
    """
    a, b = np.triu_indices(len(cuts), 1)
    parts = [_turned(order, cuts[a], cuts[b] - 1)]
    pairs = np.arange(len(cuts))
    x, y, z = (each.ravel() for each in np.meshgrid(pairs, pairs, pairs, indexing="ij"))
    rising = (x < y) & (y < z)
    i, c, j = cuts[x[rising]], cuts[y[rising]] - 1, cuts[z[rising]] - 1
    parts += [_exchanged(order, i, c, j, turn) for turn in range(4)]
    return Moves(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _turns(u: Ints, v: Ints) -> Iterator[tuple[Ints, Ints]]:
    ahead = u < v
    yield u[ahead] + 1, v[ahead]
    late = ahead & (u >= 1)
    yield u[late], v[late] - 1


def _exchanges(u: Ints, v: Ints) -> Iterator[tuple[int, Ints, Ints, Ints]]:
    """(turn, i, c, j) of all chains that make v follow u."""
    ahead = u < v
    (x, y), (q, r) = (u[ahead], v[ahead]), (u[~ahead], v[~ahead])
    for length in range(CHAIN):
        yield 0, x + 1, y - 1, y + length  # the chain from v comes after u
        yield 1, x + 1, y - length - 1, y  # the chain up to v, turned, comes after u
        yield 0, x - length, x, y - 1  # the chain up to u comes before v
        yield 2, x, x + length, y - 1  # the chain from u, turned, comes before v
        yield 0, r, r + length, q  # behind: the chain from v comes after u
        yield 2, r - length, r, q  # the chain up to v, turned, comes after u
        yield 0, r, q - length - 1, q  # the chain up to u comes before v
        yield 1, r, q - 1, q + length  # the chain from u, turned, comes before v


def _turned(order: PricedOrder, i: Ints, j: Ints) -> Moves:
    gain = order.gain(i, j, order.backward(i, j))
    return Moves(i, j, j, np.full(len(i), -1, dtype=np.intp), gain)


def _exchanged(order: PricedOrder, i: Ints, c: Ints, j: Ints, turn: int) -> Moves:
    first = (order.backward if turn & 1 else order.forward)(c + 1, j)
    second = (order.backward if turn & 2 else order.forward)(i, c)
    gain = order.gain(i, j, join(order.legs, first, second))
    return Moves(i, c, j, np.full(len(i), turn, dtype=np.intp), gain)


def apply_best(order: PricedOrder, found: Moves, least: float) -> tuple[Ints, list[int]]:
    """Places after the best moves that do not overlap, and the positions at their ends.

    Gains of moves on disjoint segments add up exactly: a segment's own cost depends on what was
    visited before it and on when, and what follows depends only on how much later it begins.
    """
    places = order.place[1:-1].copy()
    good = np.flatnonzero(found.gain > least)
    taken = np.zeros(len(places) + 2, dtype=bool)
    ends: list[int] = []
    for k in good[np.argsort(-found.gain[good], kind="stable")]:
        i, c, j, turn = int(found.i[k]), int(found.c[k]), int(found.j[k]), int(found.turn[k])
        if taken[i - 1 : j + 2].any():
            continue
        taken[i : j + 1] = True
        places[i - 1 : j] = changed(order.place, i, c, j, turn)
        ends += [i - 1, i, c, c + 1, i + j - c - 1, i + j - c, j, j + 1]
    return places, [min(end, len(places)) for end in ends]


def changed(place: Ints, i: int, c: int, j: int, turn: int) -> Ints:
    """Positions i..j of `place` after a move."""
    if turn < 0:
        return place[i : j + 1][::-1]
    first, second = place[c + 1 : j + 1], place[i : c + 1]
    return np.concatenate(
        [first[::-1] if turn & 1 else first, second[::-1] if turn & 2 else second]
    )
