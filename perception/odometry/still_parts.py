"""Still parts of the image: what moves with the camera, such as the robot's own arm.

Their depth stays the same while that of most other pixels has changed since the first image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE: Final = (64, 48)  # pixels that are compared, across and down
SAME: Final = (0.005, 0.02)  # [m], and share of the depth, that sensors are off by
MIN_CHANGED: Final = 0.5  # share of the pixels with depth that has changed, before any is still
MIN_STILL: Final = 0.1  # share of the image
AFTER: Final = 3  # times as many images as it took most of the image to change


@dataclass(slots=True)
class StillParts:
    """Which pixels have kept their depth since the first image."""

    _first: NDArray[np.float32] | None = None
    _changed: NDArray[np.bool_] | None = None
    _images: int = 0
    _half: int | None = None  # images after which most of the depth had changed

    def add(self, depth: NDArray[np.float32]) -> None:
        """Compare the depth of another image."""
        now = np.asarray(cv2.resize(depth, SIZE, interpolation=cv2.INTER_NEAREST), np.float32)
        self._images += 1
        if self._first is None or self._changed is None:
            self._first, self._changed = now, ~np.isfinite(now)
            return
        with np.errstate(invalid="ignore"):
            self._changed |= np.abs(now - self._first) > SAME[0] + SAME[1] * self._first
        if self._half is None:
            known = np.isfinite(self._first).sum()
            if (~self._changed).sum() <= (1 - MIN_CHANGED) * known:
                self._half = self._images

    def found(self, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
        """The still pixels (H, W) of images of that shape; None where there are none."""
        if self._changed is None or self._half is None or self._images < AFTER * self._half:
            return None
        still = ~self._changed
        if still.mean() < MIN_STILL:
            return None
        shown = cv2.resize(still.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST)
        return np.asarray(cv2.dilate(shown, np.ones((15, 15), np.uint8)), np.uint8) > 0
