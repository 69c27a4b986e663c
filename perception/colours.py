"""Colours as people see their differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def lab_colours(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(n, 3) L, a and b of CIE Lab (D65) of colours (n, 3) of sRGB; L from 0 to 100."""
    import cv2  # as late as possible: commands that need no colours start faster

    if not len(rgb):
        return np.empty((0, 3), np.float32)
    lab: NDArray[np.float32] = cv2.cvtColor(rgb[None].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[
        0
    ].astype(np.float32)
    return lab
