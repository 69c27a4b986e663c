"""Viewed extent: the rectangle of a recording's only place, where no layout is given."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.areas import Rectangle

#: [m] sides lie on this grid, so that the place is rewritten when it grows by a step, not a pixel
STEP: Final = 0.5
#: share of a view's points left out at each end: outliers of depth must not stretch the place
TRIM: Final = 0.02


def trimmed_extent(points: NDArray[np.float64]) -> Rectangle | None:
    """Trimmed bounding rectangle of `points` (n, 2 or more) [m], rounded outward to the grid.

    None without points.
    """
    if len(points) == 0:
        return None
    low, high = np.quantile(points[:, :2], [TRIM, 1 - TRIM], axis=0)
    low, high = np.floor(low / STEP) * STEP, np.floor(high / STEP) * STEP + STEP
    return Rectangle(float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def extended(extent: Rectangle | None, points: NDArray[np.float64]) -> Rectangle | None:
    """Union of `extent` and the trimmed extent of `points` (n, 2 or more) [m]: it only grows."""
    viewed = trimmed_extent(points)
    if extent is None or viewed is None:
        return extent or viewed
    return extent.union(viewed)
