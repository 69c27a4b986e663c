"""How soon a target can be expected at best, whatever the looks: a bound that holds for all plans.

Looks that are over by t were taken from positions of which the furthest is D seconds of driving
away, so that at most t - D seconds went into looking, at positions no further than D. They found at
most what endless looking from all such positions finds (`Memory`: the looks of one position have
a limit), and at most t - D times the best rate of a look from there, as what is left only shrinks.
The best D bounds P(found by t). Of a plan that finds with probability F, F E[t | found] is the
integral of F - P(found by t).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.viewing.looks import Looks
from planner.viewing.tour import Standing

Floats = NDArray[np.float64]

_STEPS: int = 2000  # of the integral; each is taken at its least


def seconds_times_found(
    looks: Looks, at: Standing, weight: Floats, found: float, before: float = 0.0
) -> float:
    """[s] a lower bound on F E[t | found] of one target for `found` = F, from its (k, c) `weight`.

    `before` [s] pass before the first move.
    """
    if found <= 0 or not len(weight):
        return 0.0
    driven, caps, rates = _by_distance(looks, at, weight)
    if not len(driven):
        return 0.0
    with np.errstate(divide="ignore"):
        enough = driven + np.where(rates > 0, np.minimum(found, caps) / rates, np.inf)
    reaching = caps >= found - 1e-12
    last = float(enough[reaching].min()) if reaching.any() else float(driven[-1])
    if not np.isfinite(last) or last <= 0:
        return found * before
    times = np.linspace(0.0, last, _STEPS + 1)[1:]
    best = np.zeros(_STEPS)
    for start, cap, rate in zip(driven, caps, rates, strict=True):
        np.maximum(best, np.minimum(cap, rate * np.maximum(times - start, 0.0)), out=best)
    left = np.maximum(found - best, 0.0)
    return float(found * before + left.sum() * last / _STEPS)


def _by_distance(looks: Looks, at: Standing, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """For each position and all nearer ones: seconds to it, most they can find, best rate [1/s]."""
    reached = looks.metres_from(at.cell) / looks.motion.speed
    order = [int(i) for i in np.argsort(reached, kind="stable") if np.isfinite(reached[i])]
    rate = looks.chance @ weight.sum(axis=0).astype(np.float32) / looks.seconds
    missed = np.ones(weight.shape[1])  # chance that endless looking misses what lies in a cell
    caps, rates = np.zeros(len(order)), np.zeros(len(order))
    for i, stand in enumerate(order):
        rows = looks.stand == stand
        missed *= _endlessly(looks.chance[rows].max(axis=0), 1 - looks.sensor.rho)
        caps[i] = 1.0 - float(np.prod(1.0 - np.minimum(weight @ (1.0 - missed), 1.0)))
        rates[i] = float(rate[rows].max())
    # single precision above: what is rounded down there must not make the bound too high
    margin = 1 + 1e-5
    return reached[order], np.minimum(caps * margin, 1.0), np.maximum.accumulate(rates) * margin


def _endlessly(chance: NDArray[np.float32], rest: float) -> Floats:
    """(c,) chance that any number of looks of `chance` each misses, each worth `rest` of the last.

    At most: looks are counted until what is left of them no longer matters.
    """
    if rest >= 1:
        return np.where(chance > 0, 0.0, 1.0)
    missed, each = np.ones(len(chance)), chance.astype(np.float64)
    while each.max(initial=0.0) > 1e-9:
        missed *= 1.0 - np.minimum(each, 1.0)
        each = each * rest
    return missed
