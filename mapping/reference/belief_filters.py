"""Belief filters over place categories, and the views that count (thesis section 3.3.2, 4.3).

A belief is a mapping category -> probability. Both filters are pure functions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import motion
from perception.frames import Frame


def mean_update(
    belief: Mapping[str, float], views: int, scores: Mapping[str, float]
) -> dict[str, float]:
    """Mean filter, eq. 3.5: the mean over all views; `belief` is that of `views` = k - 1.

    p(x | I_1..k) = (p(x | I_1..k-1) (k - 1) + p(x | I_k)) / k.
    """
    categories = belief.keys() | scores.keys()
    return {
        category: (belief.get(category, 0.0) * views + scores.get(category, 0.0)) / (views + 1)
        for category in sorted(categories)
    }


def bayes_update(
    belief: Mapping[str, float],
    scores: Mapping[str, float],
    categories: Collection[str],
    floor: float,
) -> dict[str, float]:
    """Discrete Bayes filter: the normalised product of prior belief and network likelihood.

    After reference [2] of the thesis (Suenderhauf et al., 2016), with a place that stays what it
    is. The prior of a place never viewed is uniform over `categories`. Prior and likelihood are
    at least `floor`, so that no single view rules a category out for good.
    """
    product = {
        category: max(belief.get(category, 0.0) if belief else 1.0, floor)
        * max(scores.get(category, 0.0), floor)
        for category in categories
    }
    total = sum(product.values())
    return {category: value / total for category, value in sorted(product.items())}


def with_prior(scores: Mapping[str, float], allowed: Collection[str]) -> dict[str, float] | None:
    """Prior knowledge (section 4.3): scores outside `allowed` set to 0, the rest renormalised.

    None where nothing is left: such a view carries no information.
    """
    kept = {category: value for category, value in scores.items() if category in allowed}
    total = sum(kept.values())
    return {category: value / total for category, value in kept.items()} if total > 0 else None


def unknown_share(frame: Frame, stride: int) -> float:
    """Share, 0..1, of pixels without depth, at every `stride`-th pixel."""
    return 1 - float(np.mean(frame.depth[::stride, ::stride] > 0))


def main_owner(owners: NDArray[np.intp], purity: float) -> int | None:
    """Place with at least a share `purity` of the points; `owners` (n,) has each point's, or -1.

    Points in no place count against every place.
    """
    inside = owners[owners >= 0]
    if len(inside) == 0:
        return None
    counts = np.bincount(inside)
    best = int(np.argmax(counts))
    return best if counts[best] >= purity * len(owners) else None


def repeats_view(
    T: NDArray[np.float64], history: Iterable[NDArray[np.float64]], distance: float, angle: float
) -> bool:
    """Repeated-view test: pose `T` (4, 4) within `distance` [m] and `angle` [rad] of one before."""
    motions = (motion(past, T) for past in history)
    return any(moved <= distance and turned <= angle for moved, turned in motions)
