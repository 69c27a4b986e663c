"""A lower bound from the clusters places form: coming into one costs the gap around it, once.

With in[j] and out[i] taken off every leg, let h(i, j) be the longest leg on the way from i to j in
the minimum spanning tree of what remains: no leg is shorter than h. h comes from the tree's nested
clusters. Let every cluster without the start cost, when it is first entered, the height at which
it joins others less its own: a leg from i to j then pays for at most the clusters around j that
leave i out, together h(i, j). So an order costs at least in[j] before and out[j] after each place
and each cluster's price before the first of its places. Orders are relaxed to sequences in which a
cluster's price comes before its places: that is scheduling with precedence from an out-tree, solved
exactly by joining a job with the best that follows it (Horn 1972; for `any`, the ratio of
discounted cost to probability of an end). With nothing joined these are split legs, so the bound is
not below theirs; where only the last place counts it is a 1-tree (Held, Karp 1970). Any `in` and
`out` will do, so steps along the bound's slope raise it.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Floats, Ints, Kernel

Array = NDArray[np.float64]
#: a step is so many times as long as one along the slope that would reach a known order's cost if
#: the bound went on as it does; longer still with each better bound, shorter after a while without
_LONG, _LONGER, _SHORTER = 4.0, 1.05, 0.8
#: that while, in steps, and over how many steps directions are averaged: at first, so many steps
#: for each more, and at most; who can make few steps needs long ones, who can make many good ones
_PATIENCE, _AVERAGED = (4, 50, 16), (10, 15, 50)
#: below this share of a first step prices stay where they are
_LEAST_SCALE = 1e-3
#: prices of places that come late move further, by what is left there to the power -_EVEN: the
#: slope there is as small as that, the leg is not; what is left counts as at least this share
_EVEN, _SOME = 0.3, 0.01
#: relative rounding of a few sums
_EPSILON = 4 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Rise:
    """What one choice of prices proves, and where to go on."""

    bound: float  # of the cost: sum of first-find probability x arrival [s]
    inward: Array  # (m,) slope of the bound in `in`
    out: Array  # (m + 1,) and in `out`


class _Clusters(NamedTuple):
    """The nested clusters of a spanning tree: places 0..m-1, the start m, then m joined ones."""

    parent: list[int]
    height: Array  # (2 m + 1,) [s]; 0 of a place
    edge: Ints  # (m, 2) the leg whose length is the height of joined cluster m + 1 + k
    start: list[bool]  # whether the start is in it


def tree_bound(
    kernel: Kernel,
    order: Ints,
    deadline: float,
    steps: int = 100_000,
    rises: Callable[[Array, Array], Rise] | None = None,
) -> float:
    """The best bound found until `deadline` (of time.perf_counter) or in so many `steps`.

    `order` (m,) is a known one, the better the sooner the bound is good. `rises` stands for
    `rise_at` of the kernel.
    """
    rises = partial(rise_at, kernel) if rises is None else rises
    m, cost, weight = kernel.size, kernel.cost(order), _weight(kernel, order)
    at = np.concatenate([_least_legs(kernel), np.zeros(m + 1)])
    best, scale, since, drift = -np.inf, _LONG, 0, np.zeros_like(at)
    for step in range(steps):
        begin = time.perf_counter()
        rise = rises(at[:m], at[m:])
        sure = rise.bound - rounding(kernel, at)
        if sure > best:
            best, since, scale = sure, 0, scale * _LONGER
        else:
            since += 1
        if since >= _grown(_PATIENCE, step):
            scale, since = scale * _SHORTER, 0
        slope = np.concatenate([rise.inward, rise.out])
        steep = float(weight @ (slope * slope))
        now = time.perf_counter()
        # not begun where it could not be ended: a step is not interrupted
        if 2 * now - begin > deadline or scale < _LONG * _LEAST_SCALE or steep < 1e-18:
            break
        drift = drift + (weight * slope - drift) / _grown(_AVERAGED, step)
        at = at + drift * (scale * max(cost - rise.bound, 1e-3 * cost) / steep)
    return best


def rounding(kernel: Kernel, prices: Array) -> float:
    """By how much rounding may lift a bound where `prices` (2 m + 1,) nearly cancel each other.

    Beyond what is a share of the bound itself: where slopes are next to nothing, steps lead far.
    """
    return float(_EPSILON * len(prices) * np.abs(prices).max()) * kernel.norm


def _grown(growth: tuple[int, int, int], step: int) -> float:
    least, pace, most = growth
    return min(least + step / pace, most)


def _least_legs(kernel: Kernel) -> Array:
    """(m,) [s] the shortest leg to each place: a price to begin with."""
    D = kernel.D.astype(np.float64)
    np.fill_diagonal(D, np.inf)
    least: Array = D.min(axis=0)
    return least


def _weight(kernel: Kernel, order: Ints) -> Array:
    """(2 m + 1,) how far each price moves for its slope."""
    w = kernel.w[order]
    left = np.append(1.0, np.cumprod(1.0 - w)) if kernel.any else 1.0 - np.append(0, np.cumsum(w))
    before, after = np.empty(kernel.size), np.empty(kernel.size)
    before[order], after[order] = left[:-1] - left[-1], left[1:] - left[-1]
    share = np.concatenate([before, after, [kernel.norm]]) / kernel.norm
    weight: Array = (np.maximum(share, 0.0) + _SOME) ** -_EVEN
    return weight


def rise_at(kernel: Kernel, inward: Array, out: Array) -> Rise:
    """The bound where `inward` (m,) and `out` (m + 1,) are taken off the legs, and its slopes."""
    m = kernel.size
    clusters = _clusters(kernel.D - inward - out[:, None], m)
    price = np.zeros(2 * m + 1)
    top = len(price) - 1
    above = np.array(clusters.parent[:top])
    price[:top] = clusters.height[above] - clusters.height[:top]
    price[clusters.start] = 0.0
    before, after = _schedule(kernel, clusters, price, inward, out)
    bound = float(price @ before + inward @ before[:m] + out[:m] @ after) + out[m] * kernel.norm
    used = np.zeros(2 * m + 1)
    np.add.at(used, above, before[:top])
    used = (used - before)[m + 1 :]
    going = np.bincount(clusters.edge[:, 0], used, m + 1)
    coming = np.bincount(clusters.edge[:, 1], used, m + 1)[:m]
    return Rise(bound, before[:m] - coming, np.append(after, kernel.norm) - going)


def _spanning_tree(R: Floats, m: int) -> tuple[Array, Ints]:
    """(m,) lengths and (m, 2) legs of the least spanning tree of R (m + 1, m), either way along."""
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
    kernel: Kernel, clusters: _Clusters, price: Array, inward: Array, out: Array
) -> tuple[Array, Array]:
    """(2 m + 1,) what is left when each price falls due, (m,) and after each place; Horn's rule.

    A block of jobs is its key (cost over probability of a first find), cost, probability, jobs.
    """
    m, some = kernel.size, kernel.any
    w = kernel.w.tolist()
    first = (inward + out[:m] * (1.0 - kernel.w if some else 1.0) + price[:m]).tolist()
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
    return _left(kernel, jobs)


_Block = tuple[float, int, float, float, list[int]]


def _key(cost: float, chance: float) -> float:
    return cost / chance if chance > 0 else float("inf") if cost >= 0 else float("-inf")


def _joined(a: _Block, b: _Block, some: bool) -> _Block:
    keep = 1.0 - a[3] if some else 1.0
    cost, chance = a[2] + keep * b[2], a[3] + keep * b[3]
    return (_key(cost, chance), a[1], cost, chance, a[4] + b[4])


def _left(kernel: Kernel, jobs: Ints) -> tuple[Array, Array]:
    m = kernel.size
    w = np.append(kernel.w, np.zeros(m + 1))[jobs]
    if kernel.any:
        with np.errstate(divide="ignore"):  # of what is certain
            missed = np.log1p(-w)
        # that one of those to come is first to be present: nothing is taken off what is close to it
        to_come = np.append(-np.expm1(np.cumsum(missed[::-1])[::-1]), 0.0)
        left = np.append(1.0, np.cumprod(1.0 - w)) * to_come
    else:
        left = np.append(np.cumsum(w[::-1])[::-1], 0.0)
    before, after = np.zeros(2 * m + 1), np.zeros(2 * m + 1)
    before[jobs], after[jobs] = left[:-1], left[1:]
    return before, after[:m]
