"""A lower bound on every order's cost: legs split between their ends, then Smith's rule.

Where out[i] + in[j] <= D[i, j] for all legs, a place j costs at least in[j] x what is left before
it plus out[j] x what is left after it, wherever it stands. Without legs this is a sum that the
order of c / w minimises (Smith 1956), c[j] = in[j] + out[j], times 1 - p[j] the latter in `any`:
exchanging two neighbours shows it. The bound is concave in `out` (in[j] = the least D[i, j] -
out[i], and a minimum over orders of what is linear in both), so steps along a supergradient raise
it; each value on the way is a bound by itself.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.ordering.kernel import Floats, Ints, Kernel
from planner.ordering.segments import Array

#: steps without a better bound after which steps become shorter
_PATIENCE, _SHORTER = 20, 0.7
#: a better bound is better by this share
_BETTER = 1e-6
#: most steps; more have not raised a bound by 0.01 %
_STEPS = 4000
#: rows that fit into a cache at once
_ROWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """A split of all legs and what it proves."""

    bound: float  # of the cost: sum of first-find probability x arrival [s]
    gradient: Array  # (m + 1,) supergradient of the bound in `out`
    inward: Array  # (m,) [s] part of a leg that counts for the place it leads to
    out: Array  # (m + 1,) [s] and for the place it comes from


def quick_bound(kernel: Kernel) -> float:
    """The bound where a leg counts wholly for the place it leads to."""
    inward = np.full(kernel.size, np.inf)
    for top in range(0, kernel.size + 1, _ROWS):
        rows = kernel.D[top : top + _ROWS].copy()
        here = np.arange(len(rows))[: kernel.size - top]
        rows[here, here + top] = np.inf
        np.minimum(inward, rows.min(axis=0), out=inward)
    return _smith(kernel, inward, np.zeros(kernel.size + 1))[0]


def best_split(kernel: Kernel, cost: float, deadline: float) -> Split:
    """The best split found until `deadline` (of time.perf_counter); `cost` is a known order's."""
    onto = np.where(_legs(kernel), kernel.D, np.inf).T.copy()
    at = np.zeros(kernel.size + 1)
    best, scale, since, drift = _split(kernel, onto, at), 1.0, 0, np.zeros(kernel.size + 1)
    for _ in range(_STEPS):
        split = _split(kernel, onto, at)
        if split.bound > best.bound + _BETTER * abs(best.bound):
            best, since = split, 0
        else:
            since += 1
        if time.perf_counter() > deadline or scale < 1e-4:
            break
        if since >= _PATIENCE:
            scale, since, at, drift = scale * _SHORTER, 0, best.out, np.zeros(len(at))
            continue
        steep = float(split.gradient @ split.gradient)
        if steep < 1e-18:
            break
        drift = 0.7 * drift + 0.3 * split.gradient
        at = at + drift * (scale * (cost - split.bound) / steep)
    return best


def _legs(kernel: Kernel) -> NDArray[np.bool_]:
    """Which entries of D are legs: none leads from a place to itself."""
    legs = np.ones(kernel.D.shape, dtype=bool)
    np.fill_diagonal(legs, False)
    return legs


def _split(kernel: Kernel, onto: Floats, out: Array) -> Split:
    reduced = onto - out
    nearest = reduced.argmin(axis=1)
    inward = reduced[np.arange(kernel.size), nearest]
    bound, before, after = _smith(kernel, inward, out)
    used = np.bincount(nearest, weights=before, minlength=kernel.size + 1)
    return Split(bound, np.append(after, kernel.norm) - used, inward, out)


def _smith(kernel: Kernel, inward: Array, out: Array) -> tuple[float, Array, Array]:
    """The bound, and what is left before and after each place in the order that attains it."""
    w = kernel.w
    c = inward + out[:-1] * (1.0 - w if kernel.any else 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(w > 0, c / w, np.where(c < 0, -np.inf, np.inf))
    order = np.argsort(ratio, kind="stable")
    before, after = np.empty(len(w)), np.empty(len(w))
    before[order], after[order] = _left(kernel, order)
    return float(out[-1] * kernel.norm + inward @ before + out[:-1] @ after), before, after


def _left(kernel: Kernel, order: Ints) -> tuple[Array, Array]:
    w = kernel.w[order]
    if kernel.any:
        left = np.concatenate([[1.0], np.cumprod(1.0 - w)])
        left -= left[-1]
    else:
        left = np.concatenate([np.cumsum(w[::-1])[::-1], [0.0]])
    return left[:-1], left[1:]
