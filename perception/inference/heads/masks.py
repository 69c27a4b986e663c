"""Instance masks: from the coarse grid that a network answers to the pixels of a box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import box_pixels
from perception.inference.preprocessing import Fitted

MAX_SIDE: Final = 8192  # cells of a grid's side


@dataclass(frozen=True, slots=True)
class MaskGrid:
    """A mask as its network answers it: positive where the thing is."""

    values: NDArray[np.float32]  # (h, w)
    extent: tuple[float, float, float, float]  # xyxy [px] of the image, edge to edge

    def within(self, box: NDArray[np.floating], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """The mask at the pixels of `box` (xyxy) in an image of `shape`, as `box_pixels` has them.

        Linear interpolation between the centres of the grid's cells.
        """
        pixels = box_pixels(box, shape)
        if pixels is None:
            return np.zeros((0, 0), bool)
        top, bottom, left, right = pixels
        height, width = self.values.shape
        if min(height, width) < 1 or max(height, width) > MAX_SIDE:
            raise ModelError(f"a mask of {width} x {height}; up to {MAX_SIDE} a side would work")
        x1, y1, x2, y2 = self.extent
        across, down = width / max(x2 - x1, 1e-6), height / max(y2 - y1, 1e-6)
        # centre of pixel (column, row) -> edges of the image -> centres of the grid's cells
        to_grid = np.array(
            [
                [across, 0, (left + 0.5 - x1) * across - 0.5],
                [0, down, (top + 0.5 - y1) * down - 0.5],
            ]
        )
        sampled = cv2.warpAffine(
            np.ascontiguousarray(self.values, np.float32),
            to_grid,
            (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        inside: NDArray[np.bool_] = sampled > 0
        return inside


def input_extent(fitted: Fitted) -> tuple[float, float, float, float]:
    """Part of the image that a network's whole input shows: xyxy [px], edge to edge."""
    height, width = fitted.tensor.shape[2:]
    low, high = ((at - np.array(fitted.shift)) / fitted.scale for at in (0.0, (width, height)))
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
