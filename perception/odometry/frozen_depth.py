"""Frozen depth: the driver repeats a depth image, bit by bit, while colour goes on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame

SIZE: Final = (40, 30)  # [px] of the colour images compared, whose pixels have hardly any noise
MOVED: Final = 3.0  # mean difference of their grey levels where the view changes


@dataclass(slots=True)
class FrozenDepth:
    """Frames without the depth that an earlier frame had with another view."""

    count: int = 0  # frames whose depth was frozen

    def without(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames; depth is taken from those where it is frozen."""
        self.count = 0
        last: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        for frame in frames:
            small = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
            grey = cv2.resize(small, SIZE, interpolation=cv2.INTER_AREA).astype(np.float32)
            if last is None or not np.array_equal(last[0], frame.depth, equal_nan=True):
                last = frame.depth, grey
            elif np.abs(grey - last[1]).mean() > MOVED:
                self.count += 1
                frame = replace(frame, depth=np.full_like(frame.depth, np.nan))
            yield frame
