"""Cluster bound: a Lagrangian lower bound on the cost of every order, raised by supergradients.

With in[j] and out[i] taken off every leg, let h(i, j) be the longest leg on the way from i to j in
the minimum spanning tree of what remains: no leg is shorter than h. h comes from the tree's nested
clusters. Let every cluster without the start cost, when it is first entered, the height at which
it joins others less its own: a leg from i to j then pays for at most the clusters around j that
leave i out, together h(i, j). So an order costs at least in[j] before and out[j] after each place
and each cluster's price before the first of its places. Orders are relaxed to sequences in which a
cluster's price comes before its places: that is scheduling with precedence from an out-tree, solved
exactly by joining a job with the best that follows it (Horn 1972; for `any`, the ratio of
discounted cost to probability of an end). Where only the last place counts it is a 1-tree (Held,
Karp 1970). The bound holds for any `in` and `out` and is concave in them, so steps along its
supergradient raise it. lab/research/ordering.md compares it with other bounds.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.ordering.reduction import Floats, Ints, ReducedProblem

Array = NDArray[np.float64]
#: step length, as a multiple of the step that would reach the known cost were the bound linear;
#: its growth with each better bound, and its decay without one
_LONG, _LONGER, _SHORTER = 4.0, 1.05, 0.8
#: steps without a better bound until decay, and steps over which directions are averaged: each
#: (at first, steps until one more, at most)
_PATIENCE, _AVERAGED = (4, 50, 16), (10, 15, 50)
#: share of the first step length at which to stop
_MIN_SCALE = 1e-3
#: preconditioner: prices of a place move by (probability left there) ** -_EVEN, as the slope is
#: proportional to what is left while the leg is not; what is left counts as at least _SOME
_EVEN, _SOME = 0.3, 0.01
#: rows of the leg matrix that fit into a cache at once
_ROWS = 64
#: relative rounding of sums
_EPSILON = 4 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class PricedBound:
    """Lower bound at one choice of prices, with its supergradient."""

    bound: float  # of the cost: sum of first-find probability x arrival [s]
    inward: Array  # (m,) supergradient in `in`
    out: Array  # (m + 1,) supergradient in `out`


class _Clusters(NamedTuple):
    """Single-linkage clusters: places 0..m-1, the start m, then m joined ones."""

    parent: list[int]
    height: Array  # (2 m + 1,) [s]; 0 of a place
    edge: Ints  # (m, 2) the leg whose length is the height of joined cluster m + 1 + k
    start: list[bool]  # whether the start is in it


def cluster_bound(
    reduced: ReducedProblem,
    order: Ints,
    deadline: float,
    steps: int = 100_000,
) -> float:
    """Best bound of the cost found until `deadline` (of time.perf_counter) or in `steps` steps.

    The cost of `order` (m,), any known one, scales the steps.
    """
    m, cost, weight = reduced.size, reduced.cost(order), _weight(reduced, order)
    at = np.concatenate([_least_legs(reduced), np.zeros(m + 1)])
    best, scale, since, drift = -np.inf, _LONG, 0, np.zeros_like(at)
    for step in range(steps):
        begin = time.perf_counter()
        priced = bound_at(reduced, at[:m], at[m:])
        sure = priced.bound - rounding(reduced, at)
        if sure > best:
            best, since, scale = sure, 0, scale * _LONGER
        else:
            since += 1
        if since >= _grown(_PATIENCE, step):
            scale, since = scale * _SHORTER, 0
        slope = np.concatenate([priced.inward, priced.out])
        steep = float(weight @ (slope * slope))
        now = time.perf_counter()
        # a step is not interrupted, so none begins that could not end in time
        if 2 * now - begin > deadline or scale < _LONG * _MIN_SCALE or steep < 1e-18:
            break
        drift = drift + (weight * slope - drift) / _grown(_AVERAGED, step)
        at = at + drift * (scale * max(cost - priced.bound, 1e-3 * cost) / steep)
    return best


def rounding(reduced: ReducedProblem, prices: Array) -> float:
    """Rounding error of a bound at `prices` (2 m + 1,) that nearly cancel each other.

    It exceeds a share of the bound where slopes are next to nothing and steps lead far.
    """
    return float(_EPSILON * len(prices) * np.abs(prices).max()) * reduced.norm


def nearest_leg_bound(reduced: ReducedProblem) -> float:
    """Lower bound of the cost without steps, for many places: the shortest leg into each place.

    The order by leg / probability minimises the sum (Smith's rule, 1956).
    """
    inward, w = _least_legs(reduced), reduced.w
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.argsort(inward / w, kind="stable")
    left = _probability_left(reduced, w[places])
    return float(inward[places] @ left[:-1])


def _grown(growth: tuple[int, int, int], step: int) -> float:
    least, pace, most = growth
    return min(least + step / pace, most)


def _least_legs(reduced: ReducedProblem) -> Array:
    """(m,) [s] the shortest leg to each place: the initial prices."""
    least = np.full(reduced.size, np.inf)
    for top in range(0, reduced.size + 1, _ROWS):
        rows = reduced.D[top : top + _ROWS].astype(np.float64)
        here = np.arange(len(rows))[: reduced.size - top]
        rows[here, here + top] = np.inf
        np.minimum(least, rows.min(axis=0), out=least)
    return least


def _weight(reduced: ReducedProblem, order: Ints) -> Array:
    """(2 m + 1,) diagonal preconditioner of the supergradient."""
    w = reduced.w[order]
    left = np.append(1.0, np.cumprod(1.0 - w)) if reduced.any else 1.0 - np.append(0, np.cumsum(w))
    before, after = np.empty(reduced.size), np.empty(reduced.size)
    before[order], after[order] = left[:-1] - left[-1], left[1:] - left[-1]
    share = np.concatenate([before, after, [reduced.norm]]) / reduced.norm
    weight: Array = (np.maximum(share, 0.0) + _SOME) ** -_EVEN
    return weight


def bound_at(reduced: ReducedProblem, inward: Array, out: Array) -> PricedBound:
    """Bound where `inward` (m,) and `out` (m + 1,) are subtracted from the legs."""
    m = reduced.size
    clusters = _clusters(reduced.D - inward - out[:, None], m)
    price = np.zeros(2 * m + 1)
    top = len(price) - 1
    above = np.array(clusters.parent[:top])
    price[:top] = clusters.height[above] - clusters.height[:top]
    price[clusters.start] = 0.0
    before, after = _schedule(reduced, clusters, price, inward, out)
    bound = float(price @ before + inward @ before[:m] + out[:m] @ after) + out[m] * reduced.norm
    used = np.zeros(2 * m + 1)
    np.add.at(used, above, before[:top])
    used = (used - before)[m + 1 :]
    going = np.bincount(clusters.edge[:, 0], used, m + 1)
    coming = np.bincount(clusters.edge[:, 1], used, m + 1)[:m]
    return PricedBound(bound, before[:m] - coming, np.append(after, reduced.norm) - going)


def _spanning_tree(R: Floats, m: int) -> tuple[Array, Ints]:
    """Minimum spanning tree (Prim) of R (m + 1, m), undirected: (m,) lengths and (m, 2) legs."""
    S = np.empty((m + 1, m + 1))
    np.minimum(R[:m], R[:m].T, out=S[:m, :m])
    S[m, :m] = S[:m, m] = R[m]
    np.fill_diagonal(S, np.inf)
    S[:, m] = np.inf
    best, come = S[m].copy(), np.full(m + 1, m, dtype=np.intp)
    length, edge = np.empty(m), np.empty((m, 2), dtype=np.intp)
    for k in range(m):
        j = int(best.argmin())
        length[k], edge[k] = best[j], (come[j], j)
        S[:, j] = np.inf
        best[j] = np.inf
        nearer = S[j] < best
        np.copyto(best, S[j], where=nearer)
        come[nearer] = j
    a, b = edge.T
    backward = (a < m) & (R[b, np.minimum(a, m - 1)] < R[a, b])
    edge[backward] = edge[backward][:, ::-1]
    return length, edge


def _clusters(R: Floats, m: int) -> _Clusters:
    length, edge = _spanning_tree(R, m)
    order = np.argsort(length, kind="stable")
    edge = edge[order]
    parent, root = [2 * m + 1] * (2 * m + 1), list(range(2 * m + 1))
    start = [False] * (2 * m + 1)
    start[m] = True
    for k, ends in enumerate(edge.tolist(), start=m + 1):
        for end in ends:
            while root[end] != end:
                root[end] = root[root[end]]
                end = root[end]
            root[end] = parent[end] = k
            start[k] |= start[end]
    return _Clusters(parent, np.append(np.zeros(m + 1), length[order]), edge, start)


def _schedule(
    reduced: ReducedProblem, clusters: _Clusters, price: Array, inward: Array, out: Array
) -> tuple[Array, Array]:
    """Optimal schedule under precedence from an out-tree (Horn 1972): (2 m + 1,) probability left
    before each job, and (m,) after each place.

    A block of jobs is its key (cost over probability of a first find), cost, probability, jobs.
    """
    m, some = reduced.size, reduced.any
    w = reduced.w.tolist()
    first = (inward + out[:m] * (1.0 - reduced.w if some else 1.0) + price[:m]).tolist()
    fee = price.tolist()
    heaps: list[list[_Block]] = [[] for _ in range(2 * m + 1)]
    for node, heap in enumerate(heaps):
        if not clusters.start[node]:
            cost, chance = (first[node], w[node]) if node < m else (fee[node], 0.0)
            block = (_key(cost, chance), node, cost, chance, [node])
            while heap and heap[0][0] < block[0]:
                block = _joined(block, heapq.heappop(heap), some)
            heapq.heappush(heap, block)
        if node < 2 * m:
            up = clusters.parent[node]
            small, large = sorted((heap, heaps[up]), key=len)
            for each in small:
                heapq.heappush(large, each)
            heaps[up] = large
    jobs = np.array([job for block in sorted(heaps[2 * m]) for job in block[4]])
    return _left(reduced, jobs)


_Block = tuple[float, int, float, float, list[int]]


def _key(cost: float, chance: float) -> float:
    return cost / chance if chance > 0 else float("inf") if cost >= 0 else float("-inf")


def _joined(a: _Block, b: _Block, some: bool) -> _Block:
    keep = 1.0 - a[3] if some else 1.0
    cost, chance = a[2] + keep * b[2], a[3] + keep * b[3]
    return (_key(cost, chance), a[1], cost, chance, a[4] + b[4])


def _left(reduced: ReducedProblem, jobs: Ints) -> tuple[Array, Array]:
    """(2 m + 1,) probability left before each job, and (m,) after each place."""
    m = reduced.size
    left = _probability_left(reduced, np.append(reduced.w, np.zeros(m + 1))[jobs])
    before, after = np.zeros(2 * m + 1), np.zeros(2 * m + 1)
    before[jobs], after[jobs] = left[:-1], left[1:]
    return before, after[:m]


def _probability_left(reduced: ReducedProblem, w: Array) -> Array:
    """(k + 1,) probability of a first find among jobs `w` (k,) from each on, in their order."""
    if not reduced.any:
        return np.append(np.cumsum(w[::-1])[::-1], 0.0)
    with np.errstate(divide="ignore"):  # log 0 of a certain place
        missed = np.log1p(-w)
    # in logarithms, as differences of numbers close to 1 would round small probabilities away
    to_come = np.append(-np.expm1(np.cumsum(missed[::-1])[::-1]), 0.0)
    left: Array = np.append(1.0, np.cumprod(1.0 - w)) * to_come
    return left
