"""Iterated local search: ratio rule, 2-opt and or-opt, perturbations, until a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from lab.ordering.moves import apply_best, far_moves, moves
from lab.ordering.reduction import Ints, ReducedProblem
from lab.ordering.segments import LegTimes, PricedOrder, leg_times

#: length of candidate lists: nearest places to which new legs are tried
_NEIGHBOURS = 8
#: places whose moves are priced at once
_BATCH = 1024
#: longest segment that a perturbation moves
_MAX_SEGMENT = 12
#: from here on sorting the legs of every place would take longer than the search may
MANY = 2000
#: powers of the probability for further initial orders
_POWERS = (0.5,)
#: longest legs between which segments are exchanged; legs drawn after each perturbation, with
#: probability by their length to this power
_CUTS, _DRAWN_CUTS, _DRAWN = 16, 20, 1.5
#: least gain as a share of the cost: rounding must not make the search cycle
_MIN_GAIN = 1e-12


def ratio_rule(reduced: ReducedProblem, power: float = 1.0) -> Ints:
    """Ratio rule, a greedy order (m,): next is the place of most probability ** power a second."""
    order = np.empty(reduced.size, dtype=np.intp)
    chance = (reduced.w**power).astype(reduced.D.dtype)
    rate, at = np.empty_like(chance), reduced.root
    for k in range(reduced.size):
        # whole rows: a gather of those that are left takes longer
        np.add(reduced.D[at], 1e-9, out=rate)
        np.divide(chance, rate, out=rate)
        order[k] = at = int(np.argmax(rate))
        chance[at] = -np.inf
    return order


def neighbours(reduced: ReducedProblem, order: Ints, count: int = _NEIGHBOURS) -> Ints:
    """Candidate lists (m + 1, count): places to try after each place.

    The quickest to reach and explore; of very many places, those that follow soon in `order`.
    """
    if reduced.size > MANY:
        following = np.append(reduced.root, order)
        at = np.minimum(
            np.arange(reduced.size + 1)[:, None] + np.arange(2, count + 2), reduced.size
        )
        rows = np.empty((reduced.size + 1, count), dtype=np.intp)
        rows[following] = following[at]
        return rows
    D = reduced.D.copy()
    np.fill_diagonal(D, np.inf)
    count = min(count, reduced.size - 1)
    return np.argpartition(D, count - 1, axis=1)[:, :count]


def descend(
    order: PricedOrder, around: Ints, neighbour_rows: Ints, late: Callable[[], bool]
) -> PricedOrder:
    """Local optimum: improving moves from places `around` applied until none is left, or late."""
    while len(around) and not late():
        around, rest = around[:_BATCH], around[_BATCH:]
        a = np.repeat(around, neighbour_rows.shape[1])
        b = neighbour_rows[around].ravel()
        found = moves(order, a, b)
        places, ends = apply_best(order, found, _MIN_GAIN * order.cost)
        better = PricedOrder(order.legs, places) if ends else order
        if better.cost < order.cost:
            order, around = better, np.union1d(rest, better.place[:-1][ends])
        else:
            around = rest
    return order


def improve(
    reduced: ReducedProblem,
    start: Ints,
    deadline: float,
    seed: int,
    perturbations: int | None = None,
) -> tuple[Ints, float]:
    """Best order found from `start` until `deadline` (of time.perf_counter), and its cost.

    `perturbations` bounds the work instead where results must not depend on the machine's speed.
    """

    def late() -> bool:
        return time.perf_counter() > deadline

    legs, neighbour_rows = leg_times(reduced), neighbours(reduced, start)
    best, done = _optimised(legs, start, neighbour_rows, late), 0
    for power in _POWERS:
        if reduced.size <= MANY and not late():
            other = _optimised(legs, ratio_rule(reduced, power), neighbour_rows, late)
            best = min(best, other, key=lambda order: order.cost)
    rng = np.random.default_rng(seed)
    while not late() and best.end > 3 and (perturbations is None or done < perturbations):
        best = _perturb(best, legs, neighbour_rows, rng, late)
        if reduced.size <= MANY and not late():
            best = _exchange_random(best, rng, neighbour_rows, late)
        done += 1
    return best.place[1:-1].copy(), best.cost


def _optimised(
    legs: LegTimes, start: Ints, neighbour_rows: Ints, late: Callable[[], bool]
) -> PricedOrder:
    """Local optimum reached from `start`."""
    order = descend(PricedOrder(legs, start), np.arange(len(start) + 1), neighbour_rows, late)
    return order if len(start) > MANY else _exchange_longest(order, neighbour_rows, late)


def _exchange_longest(
    order: PricedOrder, neighbour_rows: Ints, late: Callable[[], bool]
) -> PricedOrder:
    """Segment exchanges and reversals between the longest legs, until nothing is gained."""
    while not late():
        places = order.place[: order.end + 1]
        legs = order.legs(places[:-1], places[1:])
        cuts = np.sort(np.argsort(-legs, kind="stable")[:_CUTS]) + 1
        better = _exchange_between(order, cuts, neighbour_rows, late)
        if better is order:
            break
        order = better
    return order


def _exchange_random(
    order: PricedOrder, rng: np.random.Generator, neighbour_rows: Ints, late: Callable[[], bool]
) -> PricedOrder:
    """Segment exchanges and reversals between legs drawn by their length."""
    places = order.place[: order.end + 1]
    legs = order.legs(places[:-1], places[1:])
    drawn = rng.exponential(size=len(legs)) / np.maximum(legs, 1e-9) ** _DRAWN
    return _exchange_between(
        order, np.sort(np.argsort(drawn, kind="stable")[:_DRAWN_CUTS]) + 1, neighbour_rows, late
    )


def _exchange_between(
    order: PricedOrder, cuts: Ints, neighbour_rows: Ints, late: Callable[[], bool]
) -> PricedOrder:
    places, ends = apply_best(order, far_moves(order, cuts), _MIN_GAIN * order.cost)
    better = PricedOrder(order.legs, places) if ends else order
    if better.cost >= order.cost:
        return order
    return descend(better, np.unique(better.place[:-1][ends]), neighbour_rows, late)


def _perturb(
    best: PricedOrder,
    legs: LegTimes,
    neighbour_rows: Ints,
    rng: np.random.Generator,
    late: Callable[[], bool],
) -> PricedOrder:
    """The better of `best` and the local optimum from it with two adjacent segments exchanged."""
    longest = min(best.end // 2, _MAX_SEGMENT)
    one, two = (int(length) for length in rng.integers(1, longest + 1, 2))
    i = int(rng.integers(1, max(2, best.end - one - two + 2)))
    c, j = i + one - 1, min(i + one + two - 1, best.end)
    places = best.place[1:-1].copy()
    places[i - 1 : j] = np.concatenate([best.place[c + 1 : j + 1], best.place[i : c + 1]])
    ends = np.array([i - 1, i, i + j - c - 1, i + j - c, j, min(j + 1, len(places))])
    perturbed = PricedOrder(legs, places)
    perturbed = descend(perturbed, np.unique(perturbed.place[:-1][ends]), neighbour_rows, late)
    return perturbed if perturbed.cost < best.cost - _MIN_GAIN * best.cost else best
