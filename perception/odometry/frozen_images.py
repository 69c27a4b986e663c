"""Frozen images: the driver repeats depth or colour, bit by bit, while the other goes on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame

SIZE: Final = (40, 30)  # [px] of the images by which a change of the view is noticed
MOVED: Final = 3.0  # mean difference of grey levels where the view changes
MOVED_DEPTH: Final = 0.03  # the same of depth, relative; ...
MOVED_SHARE: Final = 90  # ... percentile, since a turn moves little but edges

_View = tuple[NDArray[np.float32], NDArray[np.float32]]  # grey levels and depth, of SIZE


@dataclass(slots=True)
class FrozenImages:
    """Notices frames whose colour and depth are of two moments."""

    count: int = 0  # of such frames
    _held: dict[str, tuple[NDArray[Any], _View]] = field(default_factory=dict)

    def add(self, frame: Frame) -> bool:
        """Whether an image of the next frame is a copy of the last, and the other moves on."""
        view, frozen = _view(frame), False
        for name, image, other in (("depth", frame.depth, 0), ("rgb", frame.rgb, 1)):
            if name not in self._held or not _is_same(self._held[name][0], image):
                self._held[name] = image, view  # the image, and the view where it began
            else:
                frozen |= _moved(self._held[name][1], view, other)
        self.count += frozen
        return frozen


def _view(frame: Frame) -> _View:
    grey = cv2.resize(
        cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY), SIZE, interpolation=cv2.INTER_AREA
    )
    depth = cv2.resize(frame.depth, SIZE, interpolation=cv2.INTER_NEAREST)
    return np.asarray(grey, np.float32), np.asarray(depth, np.float32)


def _is_same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    return np.array_equal(a, b, equal_nan=a.dtype == np.float32)


def _moved(before: _View, now: _View, image: int) -> bool:
    """Whether grey levels (0) or depth (1) changed as in another view."""
    change = np.abs(now[image] - before[image])
    if image == 0:
        return bool(change.mean() > MOVED)
    known = np.isfinite(change)
    relative = change[known] / before[1][known]
    return bool(known.any() and np.percentile(relative, MOVED_SHARE) > MOVED_DEPTH)
