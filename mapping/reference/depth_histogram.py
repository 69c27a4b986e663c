"""Depth-histogram localisation of a detection (thesis section 3.3.1, Fig. 3.8)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.projection import back_project
from mapping.reference.settings import Estimator, ReferenceSettings
from perception.frames import Frame, box_pixels

Points = NDArray[np.float64]


def bin_width(depths: Points, estimator: Estimator) -> float:
    """Histogram bin width [m] for `depths` (n,) by the rules of [56], [57], [58]; 0 = one bin.

    The same widths as `numpy.histogram_bin_edges`, which would allocate every bin they ask for.
    """
    n = len(depths)
    if estimator == "fd":
        low, high = np.percentile(depths, [25, 75])
        return 2 * float(high - low) / math.cbrt(n)
    sigma = float(np.std(depths))
    if estimator == "scott":
        return math.cbrt(24 * math.sqrt(math.pi) / n) * sigma
    if n < 3 or sigma == 0:
        return 0.0
    spread = math.sqrt(6 * (n - 2) / ((n + 1) * (n + 3)))
    skewness = abs(float(np.mean(((depths - np.mean(depths)) / sigma) ** 3)))
    bins = 1 + math.log2(n) + math.log2(1 + skewness / spread)
    return float(np.ptp(depths)) / bins


def fullest_bin(depths: Points, estimator: Estimator, max_bins: int) -> NDArray[np.bool_]:
    """Mode of the histogram: mask (n,) of `depths` in the fullest bin, the nearest on a tie."""
    low, extent = float(np.min(depths)), float(np.ptp(depths))
    width = bin_width(depths, estimator)
    bins = min(math.ceil(min(extent / width, max_bins)), max_bins) if width > 0 else 1
    if bins < 2:
        return np.ones(len(depths), dtype=bool)
    index = np.minimum(((depths - low) * (bins / extent)).astype(np.intp), bins - 1)
    fullest: NDArray[np.bool_] = index == np.argmax(np.bincount(index, minlength=bins))
    return fullest


def localise(frame: Frame, box: NDArray[np.floating], settings: ReferenceSettings) -> Points | None:
    """Object centre in the camera frame, (3,) [m]: mean of the points of the fullest bin.

    None where the box holds no pixel of the image, or too little depth. The reference's known
    weakness is part of it: a box that holds more wall than object is localised on the wall.
    """
    clipped = box_pixels(box, frame.depth.shape)
    if clipped is None:
        return None
    top, bottom, left, right = clipped
    patch = frame.depth[top:bottom, left:right]
    rows, columns = np.nonzero(patch > 0)  # nan compares false
    unknown = 1 - len(rows) / patch.size
    if len(rows) < settings.min_points or unknown > settings.max_unknown_box:
        return None
    depths = patch[rows, columns].astype(np.float64)
    kept = fullest_bin(depths, settings.estimator, settings.max_bins)
    points = back_project(rows[kept] + top, columns[kept] + left, depths[kept], frame.K)
    return np.asarray(points.mean(axis=0), dtype=np.float64)
