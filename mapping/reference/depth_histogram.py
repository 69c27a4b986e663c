"""Depth-histogram localisation of a detection (thesis section 3.3.1, Fig. 3.8)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from mapping.frames.projection import back_project
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame, box_pixels

Points = NDArray[np.float64]


def freedman_diaconis(depths: Points) -> float:
    """Histogram bin width [m] for `depths` (n,) by the rule of [56]; 0 = one bin.

    The same width as `numpy.histogram_bin_edges`, which would allocate every bin it asks for.
    """
    low, high = np.percentile(depths, [25, 75])
    return 2 * float(high - low) / math.cbrt(len(depths))


def fullest_bin(depths: Points, width: float, max_bins: int) -> NDArray[np.bool_]:
    """Mode of the histogram: mask (n,) of `depths` in the fullest bin, the nearest on a tie."""
    low, extent = float(np.min(depths)), float(np.ptp(depths))
    bins = min(math.ceil(min(extent / width, max_bins)), max_bins) if width > 0 else 1
    if bins < 2:
        return np.ones(len(depths), dtype=bool)
    index = np.minimum(((depths - low) * (bins / extent)).astype(np.intp), bins - 1)
    fullest: NDArray[np.bool_] = index == np.argmax(np.bincount(index, minlength=bins))
    return fullest


def box_depth(
    frame: Frame, box: NDArray[np.floating], mask: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float32], tuple[int, int, int, int], int] | None:
    """(depth in a box, nan outside its mask; its pixel range; how many pixels count), or None.

    Raises ModelError where the mask does not fit the box.
    """
    pixels = box_pixels(box, frame.depth.shape)
    if pixels is None:
        return None
    top, bottom, left, right = pixels
    patch = frame.depth[top:bottom, left:right]
    if mask is None:
        return patch, pixels, patch.size
    if mask.shape != patch.shape:
        raise ModelError(
            f"frame {frame.id}: a mask of {mask.shape} for a box of {patch.shape} pixels; "
            "one of the box's size would work"
        )
    return np.where(mask, patch, np.float32(np.nan)), pixels, max(int(mask.sum()), 1)


def localise(
    frame: Frame,
    box: NDArray[np.floating],
    settings: ReferenceSettings,
    mask: NDArray[np.bool_] | None = None,
    bin_width: Callable[[Points], float] = freedman_diaconis,
) -> Points | None:
    """Object centre in the camera frame, (3,) [m]: mean of the points of the fullest bin.

    None where the box holds no pixel of the image, or no depth. The reference's known
    weakness is kept: a box that holds more wall than object is localised on the wall, unless
    a mask (h, w) marks the pixels that show the object.
    """
    found = box_depth(frame, box, mask)
    if found is None:
        return None
    patch, (top, _, left, _), _ = found
    rows, columns = np.nonzero(patch > 0)  # nan compares false
    if not len(rows):
        return None
    depths = patch[rows, columns].astype(np.float64)
    kept = fullest_bin(depths, bin_width(depths), settings.max_bins)
    points = back_project(rows[kept] + top, columns[kept] + left, depths[kept], frame.K)
    return np.asarray(points.mean(axis=0), dtype=np.float64)
