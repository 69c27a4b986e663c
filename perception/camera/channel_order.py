"""Order of colour channels: whether the images of a place have red and blue exchanged.

Lamps, wood, skin and most paint are warm, so over the views of a room red prevails. In single
images blue may; it hardly does in a dozen views of different parts.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_VIEWS: Final = 12  # to conclude anything
SIZE: Final = (80, 60)  # that images are shrunk to
COLOURED: Final = 30  # levels of 255 by which red and blue of a coloured pixel differ
BRIGHT: Final = 250  # levels from which a pixel may be clipped
BLUE_SHARE: Final = 0.05  # of pixels that are blue ...
OVER_RED: Final = 1.5  # ... and so many times as many as red ones
BLUER: Final = 0.03  # by which the mean of blue is more than that of red, as a logarithm


class ChannelOrder:
    """Judge of the order of channels, by views of different parts of a place."""

    def __init__(self) -> None:
        self._count = 0
        self._sums = np.zeros(3)  # over views: shares of red and of blue pixels, how much bluer

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Take in an image (H, W, 3)."""
        small = cv2.resize(rgb, SIZE, interpolation=cv2.INTER_AREA).astype(np.float32)
        red, blue = small[..., 0], small[..., 2]
        clear = small.max(axis=2) < BRIGHT
        shares = [(clear & (d > COLOURED)).mean() for d in (red - blue, blue - red)]
        bluer = np.log((blue.mean() + 1) / (red.mean() + 1))
        self._count += 1
        self._sums += (*shares, bluer)

    @property
    def told(self) -> str:
        """A sentence for people where red and blue seem to be exchanged; "" elsewhere."""
        if self._count < MIN_VIEWS:
            return ""
        red, blue, bluer = self._sums / self._count
        if blue < max(BLUE_SHARE, OVER_RED * red) or bluer < BLUER:
            return ""
        return (
            f"colour seems to be in the order blue, green, red: {100 * blue:.0f} % of its pixels "
            f"are blue and {100 * red:.0f} % are red, as of few rooms; --bgr of a recording, or "
            "rgb[:, :, ::-1] of a frame, would work if so"
        )
