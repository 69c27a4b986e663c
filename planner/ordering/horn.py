"""Jobs under nested precedence in the best order, compiled: Horn's rule (1972) with skew heaps.

A job pays its cost x the probability left before it and takes its own part of that probability; a
cluster's job, without probability, comes before those of all that lies in it. A job joins with the
best that follows it as long as that one has less cost for its probability; what is joined goes in
order of cost over probability. Heaps that melt into each other: Sleator, Tarjan 1986.
"""

from __future__ import annotations

import numpy as np

from planner.ordering.compiled import compiled
from planner.ordering.memories import Array, Whole


@compiled("f8(f8,f8)")
def _key(cost: float, chance: float) -> float:
    if chance > 0:
        return cost / chance
    return np.inf if cost >= 0 else -np.inf


@compiled("i8(i8,i8,f8[::1],i8[::1],i8[::1])")
def _melted(a: int, b: int, key: Array, one: Whole, other: Whole) -> int:
    """The heap of heaps `a` and `b`, each its top or -1; `one` and `other` are a top's halves."""
    if a < 0:
        return b
    if b < 0:
        return a
    if key[b] < key[a] or (key[b] == key[a] and b < a):
        a, b = b, a
    top = at = a
    rest = other[at]
    other[at] = one[at]
    while rest >= 0:
        if key[b] < key[rest] or (key[b] == key[rest] and b < rest):
            rest, b = b, rest
        one[at] = at = rest
        rest = other[at]
        other[at] = one[at]
    one[at] = b
    return top


@compiled("i8(i8[::1],b1[::1],f8[::1],f8[::1],b1,i8[::1])")
def horn(parent: Whole, idle: np.ndarray, cost: Array, w: Array, some: bool, jobs: Whole) -> int:
    """Fill `jobs` (n,) with the best order of the jobs and return how many there are.

    Nodes 0..n - 1, children before their `parent`, the last one the root; the first len(w) are
    places with probability `w`, the others' jobs have none. Nodes that are `idle` have no job, and
    their parents are idle. `cost` (n,) is paid on what is left before the job; in the model of
    `some` present a job's probability is a share of what is left.
    """
    n, m = len(parent), len(w)
    key, price, chance = np.empty(n), cost.copy(), np.zeros(n)
    one, other = np.full(n, -1, dtype=np.int64), np.full(n, -1, dtype=np.int64)
    heap, last = np.full(n, -1, dtype=np.int64), np.arange(n)
    following = np.full(n, -1, dtype=np.int64)
    chance[:m] = w
    for node in range(n):
        top = heap[node]
        if not idle[node]:
            key[node] = _key(price[node], chance[node])
            while top >= 0 and key[top] < key[node]:
                keep = 1.0 - chance[node] if some else 1.0
                price[node] += keep * price[top]
                chance[node] += keep * chance[top]
                key[node] = _key(price[node], chance[node])
                following[last[node]], last[node] = top, last[top]
                top = _melted(one[top], other[top], key, one, other)
            top = _melted(top, node, key, one, other)
        if node < n - 1:
            heap[parent[node]] = _melted(heap[parent[node]], top, key, one, other)
        else:
            heap[node] = top
    top, count = heap[n - 1], 0
    while top >= 0:
        job = top
        while job >= 0:
            jobs[count] = job
            count += 1
            job = following[job]
        top = _melted(one[top], other[top], key, one, other)
    return count


@compiled("void(i8[::1],i8,f8[::1],b1,f8[::1],f8[::1])")
def left_along(jobs: Whole, count: int, w: Array, some: bool, before: Array, after: Array) -> None:
    """Fill what is left `before` (n,) each of `count` jobs and `after` (m,) each place."""
    m, rest, left = len(w), 0.0, 1.0
    for k in range(count - 1, -1, -1):  # from the last: nothing is taken off what it is close to
        job = jobs[k]
        if job < m:
            after[job] = rest
            rest = w[job] + (1.0 - w[job] if some else 1.0) * rest
        before[job] = rest
    if not some:
        return
    for k in range(count):
        job = jobs[k]
        before[job] *= left
        if job < m:
            left *= 1.0 - w[job]
            after[job] *= left
