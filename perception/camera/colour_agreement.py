"""Colour agreement: whether two colour images show one scene from where their depth has it.

Points of one image are transformed into the other camera, and the grey levels of both are compared
where depth agrees (photometric consistency, by normalised cross-correlation). Neither exposure nor
contrast matters.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import TOLERANCE, DepthSamples, Floats, nearest_pixels

BLUR: Final = 0.7  # samples by which grey levels are smoothed
MIN_POINTS: Final = 150  # that both images show
MIN_CONTRAST: Final = 4.0  # standard deviation of their grey levels
_NEAR: Final = 2 * TOLERANCE  # share of its depth by which a point may be off the surface


def grey_samples(rgb: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Grey levels of an image (H, W, 3) on the grid (h, w) of its depth samples."""
    small = cv2.resize(rgb, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), BLUR), np.float32)


def colour_agreement(
    a: DepthSamples,
    grey_a: NDArray[np.float32],
    b: DepthSamples,
    grey_b: NDArray[np.float32],
    T_a_b: Floats,
) -> float | None:
    """Correlation, -1 to 1, of the grey levels of points that both images show; None for few.

    `T_a_b` (4, 4) takes camera b to camera a.
    """
    seen, rows, columns = nearest_pixels(a, b.points @ T_a_b[:3, :3].T + T_a_b[:3, 3])
    z = b.points[seen] @ T_a_b[2, :3] + T_a_b[2, 3]
    measured = a.depth[rows, columns]
    with np.errstate(invalid="ignore"):
        near = np.abs(z - measured) <= _NEAR * measured
    there = grey_b[np.isfinite(b.depth)][seen[near]]
    here = grey_a[rows[near], columns[near]]
    if len(here) < MIN_POINTS or min(here.std(), there.std()) < MIN_CONTRAST:
        return None
    return float(np.corrcoef(here, there)[0, 1])
