"""The clusters' bound of `trees`, compiled: one step of it in a fraction of a millisecond.

The same spanning tree, clusters and schedule; the tree by Prim's way over the dense matrix of legs,
prices taken off on the way.
"""

from __future__ import annotations

import numpy as np

from planner.ordering.compiled import compiled
from planner.ordering.horn import horn, left_along
from planner.ordering.kernel import Kernel
from planner.ordering.memories import Array, Whole
from planner.ordering.trees import Rise


class Rises:
    """What clusters prove of one kernel, at any prices."""

    def __init__(self, kernel: Kernel) -> None:
        m = kernel.size
        legs = np.full((m + 1, m + 1), np.inf)
        legs[:, :m] = kernel.D
        np.fill_diagonal(legs, np.inf)
        self._kernel, self._legs, self._onto = kernel, legs, legs.T.copy()
        self._length, self._edge = np.empty(m), np.empty((m, 2), dtype=np.int64)
        self._parent = np.empty(2 * m + 1, dtype=np.int64)
        self._height, self._start = np.empty(2 * m + 1), np.empty(2 * m + 1, dtype=np.bool_)

    def at(self, inward: Array, out: Array) -> Rise:
        """The bound where `inward` (m,) and `out` (m + 1,) are taken off the legs; its slopes."""
        kernel, m = self._kernel, self._kernel.size
        _spanning_tree(self._legs, self._onto, inward, out, self._length, self._edge)
        order = np.argsort(self._length, kind="stable")
        edge = self._edge[order]
        _clusters(self._length[order], edge, self._parent, self._height, self._start)
        slope_in, slope_out = np.empty(m), np.empty(m + 1)
        bound = _rise(
            self._parent, self._height, edge, self._start, kernel.w, kernel.any,
            kernel.norm, inward, out, slope_in, slope_out,
        )  # fmt: skip
        return Rise(bound, slope_in, slope_out)


@compiled("i8(f8[::1])")
def _least_at(values: Array) -> int:
    """Where the first least of `values` stands: by sixteens, four at once, then in the best.

    One after another would take two and a half times as long, as each waits for the one before.
    """
    whole, at, least = len(values) // 16 * 16, -1, np.inf
    for top in range(0, whole, 16):
        a, b, c, d = values[top], values[top + 1], values[top + 2], values[top + 3]
        for k in range(top + 4, top + 16, 4):
            a = values[k] if values[k] < a else a
            b = values[k + 1] if values[k + 1] < b else b
            c = values[k + 2] if values[k + 2] < c else c
            d = values[k + 3] if values[k + 3] < d else d
        a, c = (b if b < a else a), (d if d < c else c)
        a = c if c < a else a
        if a < least:
            least, at = a, top
    if at >= 0:
        while values[at] != least:
            at += 1
    for k in range(whole, len(values)):
        if values[k] < least:
            least, at = values[k], k
    return max(at, 0)


@compiled("void(f8[:,::1],f8[:,::1],f8[::1],f8[::1],f8[::1],i8[:,::1])")
def _spanning_tree(
    legs: Array, onto: Array, inward: Array, out: Array, length: Array, edge: Whole
) -> None:
    """The least spanning tree of `legs` (m + 1, m + 1) less prices, either way along.

    `onto` is its transpose; fills `length` (m,) and `edge` (m, 2), a leg from first to second.
    """
    m = len(inward)
    best, come = np.full(m, np.inf), np.full(m, m, dtype=np.int64)
    # of what is in the tree nothing is taken off but endlessly much added: no leg leads there
    to, away = inward.copy(), out.copy()
    k = m
    for step in range(m):
        come_in, go = inward[k] if k < m else 0.0, out[k]
        row, column = legs[k], onto[k]
        for j in range(m):
            forth, back = row[j] - to[j] - go, column[j] - come_in - away[j]
            least = forth if forth < back else back
            nearer = least < best[j]
            best[j] = least if nearer else best[j]
            come[j] = k if nearer else come[j]
        k = _least_at(best)
        length[step], a = best[k], come[k]
        edge[step, 0], edge[step, 1] = a, k
        if a < m and legs[k, a] - inward[a] - out[k] < legs[a, k] - inward[k] - out[a]:
            edge[step, 0], edge[step, 1] = k, a
        best[k], to[k], away[k] = np.inf, -np.inf, -np.inf


@compiled("void(f8[::1],i8[:,::1],i8[::1],f8[::1],b1[::1])")
def _clusters(length: Array, edge: Whole, parent: Whole, height: Array, start: np.ndarray) -> None:
    """Nest the clusters of a tree, its edges by rising length; fills `parent`, `height`, `start`.

    Places 0..m-1, the start m, then m joined clusters: each one's parent (2 m + 1 of the last),
    height and whether the start is in it.
    """
    m = len(length)
    root = np.arange(2 * m + 1)
    height[: m + 1], start[:] = 0.0, False
    start[m], parent[2 * m] = True, 2 * m + 1
    for k in range(m):
        new = m + 1 + k
        height[new] = length[k]
        for side in range(2):
            end = edge[k, side]
            while root[end] != end:
                root[end] = root[root[end]]
                end = root[end]
            root[end] = parent[end] = new
            start[new] |= start[end]


@compiled("f8(i8[::1],f8[::1],i8[:,::1],b1[::1],f8[::1],b1,f8,f8[::1],f8[::1],f8[::1],f8[::1])")
def _rise(
    parent: Whole,
    height: Array,
    edge: Whole,
    start: np.ndarray,
    w: Array,
    some: bool,
    norm: float,
    inward: Array,
    out: Array,
    slope_in: Array,
    slope_out: Array,
) -> float:
    """The bound, but for `trees.rounding`; fills its slopes (m,) and (m + 1,)."""
    m, n = len(w), len(parent)
    price, cost = np.zeros(n), np.zeros(n)
    for node in range(n - 1):
        if not start[node]:
            price[node] = height[parent[node]] - height[node]
        cost[node] = price[node]
        if node < m:
            cost[node] += inward[node] + out[node] * (1.0 - w[node] if some else 1.0)
    jobs, before, after = np.empty(n, dtype=np.int64), np.zeros(n), np.zeros(m)
    left_along(jobs, horn(parent, start, cost, w, some, jobs), w, some, before, after)
    bound: float = out[m] * norm
    for node in range(n):
        bound += price[node] * before[node]
    slope_out[m] = norm
    for j in range(m):
        bound += inward[j] * before[j] + out[j] * after[j]
        slope_in[j], slope_out[j] = before[j], after[j]
    used = -before
    for node in range(n - 1):
        used[parent[node]] += before[node]
    for k in range(m):
        # the leg is as long as the cluster is high: longer for its parts, shorter for itself
        slope_out[edge[k, 0]] -= used[m + 1 + k]
        slope_in[edge[k, 1]] -= used[m + 1 + k]
    return bound
