"""Belief filters over place categories, and the views that count (thesis section 3.3.2, 4.3).

A belief is a mapping category -> probability.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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
