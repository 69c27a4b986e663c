"""The one place of a recording that comes without a layout: what the camera has seen so far."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Bounds = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax [m]

#: [m] sides lie on this grid, so that the place is rewritten when it grows by a step, not a pixel
STEP: Final = 0.5
#: share of a view's points left out at each end: stray depths must not stretch the place
TRIM: Final = 0.02


def seen_bounds(points: NDArray[np.float64]) -> Bounds | None:
    """Bounds of `points` (n, 2 or more) [m], trimmed, and rounded outward to the grid."""
    if len(points) == 0:
        return None
    low, high = np.quantile(points[:, :2], [TRIM, 1 - TRIM], axis=0)
    low, high = np.floor(low / STEP) * STEP, np.floor(high / STEP) * STEP + STEP
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def grown(bounds: Bounds | None, points: NDArray[np.float64]) -> Bounds | None:
    """`bounds` and the trimmed bounds of `points` together: it only ever grows."""
    seen = seen_bounds(points)
    if bounds is None or seen is None:
        return bounds or seen
    return (
        min(bounds[0], seen[0]),
        max(bounds[1], seen[1]),
        min(bounds[2], seen[2]),
        max(bounds[3], seen[3]),
    )
