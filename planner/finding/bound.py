"""How soon a target can be expected at best, whatever the looks: a bound that holds for all plans.

P(found by t) is at most: the chance that an instance lies where some look can show it that one can
have driven to and taken by t; and t times the best rate at which any look brings instances, as what
is left of them only shrinks. Of a plan that finds with probability F,
F E[t | found] = integral of F - P(found by t), and each such P may be put in place of the plan's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.viewing.looks import Looks
from planner.viewing.tour import Standing


def earliest(looks: Looks, at: Standing, before: float = 0.0) -> NDArray[np.float64]:
    """(c,) [s] when each cell can have been shown by a look at the earliest; inf where never."""
    reached = looks.metres_from(at.cell) / looks.motion.speed + looks.motion.picture + before
    soonest = np.full(len(looks.cells), np.inf)
    for stand, seconds in enumerate(reached):
        shown = (looks.chance[looks.stand == stand] > 0).any(axis=0)
        soonest[shown] = np.minimum(soonest[shown], seconds)
    return soonest


def seconds_times_found(
    looks: Looks,
    at: Standing,
    weight: NDArray[np.float64],
    found: float,
    before: float = 0.0,
) -> float:
    """[s] a lower bound on F E[t | found] of one target for `found` = F, from its (k, c) `weight`.

    `before` [s] pass before the first move.
    """
    soonest = earliest(looks, at, before)
    order = np.argsort(soonest, kind="stable")
    order = order[np.isfinite(soonest[order])]
    if not len(order) or found <= 0:
        return 0.0
    times = soonest[order]
    inside = np.clip(np.cumsum(weight[:, order], axis=1), 0.0, 1.0)
    reachable = 1.0 - np.prod(1.0 - inside, axis=0)  # from times[i] until times[i + 1]
    rate = float((looks.chance @ weight.sum(axis=0).astype(np.float32) / looks.seconds).max())
    edges = np.append(times, np.inf)
    return found * float(edges[0]) + sum(
        _area(found, float(cap), rate, float(a) - before, float(b) - before)
        for cap, a, b in zip(reachable, edges[:-1], edges[1:], strict=True)
        if b > a
    )


def _area(found: float, cap: float, rate: float, a: float, b: float) -> float:
    """Integral over a..b [s] of max(0, found - min(cap, rate t)); where endless, up to its end."""
    top = min(found, cap)
    knee = top / rate if rate > 0 else np.inf  # from here on the cap counts
    if not np.isfinite(b):
        b = max(a, knee)
        if not np.isfinite(b):
            return 0.0
    slope_end = float(np.clip(knee, a, b))
    sloped = found * (slope_end - a) - rate * (slope_end**2 - a**2) / 2
    return float(sloped + max(found - top, 0.0) * (b - slope_end))
