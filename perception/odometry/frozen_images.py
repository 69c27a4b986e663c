"""Frozen images: the driver repeats depth or colour, bit by bit, while the other goes on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose
from perception.frames import Frame

SIZE: Final = (40, 30)  # [px] of the images by which a change of the view is noticed
MOVED: Final = 3.0  # mean difference of grey levels where the view changes
MOVED_DEPTH: Final = 0.03  # the same of depth, relative; ...
MOVED_SHARE: Final = 90  # ... percentile, since a turn moves little but edges

_View = tuple[NDArray[np.float32], NDArray[np.float32]]  # grey levels and depth, of SIZE


@dataclass(slots=True)
class FrozenImages:
    """Frames without the depth of those whose colour and depth are of two moments."""

    numbers: set[int] = field(default_factory=set)  # of frames with a frozen image

    def without(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames; depth is taken from those where one image is frozen, and the other moves."""
        self.numbers.clear()
        held: dict[str, tuple[NDArray[Any], _View]] = {}  # image, and the view where it began
        for number, frame in enumerate(frames):
            view, frozen = _view(frame), False
            for name, image, other in (("depth", frame.depth, 0), ("rgb", frame.rgb, 1)):
                if name not in held or not _is_same(held[name][0], image):
                    held[name] = image, view
                else:
                    frozen |= _moved(held[name][1], view, other)
            if frozen:
                self.numbers.add(number)
                frame = replace(frame, depth=np.full_like(frame.depth, np.nan))
            yield frame

    def poses(self, found: Iterable[Pose | None]) -> list[Pose | None]:
        """Poses without those of frozen frames, which nothing measured."""
        return [None if n in self.numbers else T for n, T in enumerate(found)]


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
