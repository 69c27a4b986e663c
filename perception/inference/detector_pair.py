"""Detector pair: two networks that are weak alone and err in different ways, as one detector.

The first runs on every frame. The second, which is slower, runs on frames from a new point of view.
Detections keep the name of their network.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import motion
from perception.frames import Detections, Detector, Frame

NEW_DISTANCE: Final = 0.1  # [m] of the camera from the last frame of the second network ...
NEW_ANGLE: Final = math.radians(5)  # ... or of its orientation, that make a new point of view


class DetectorPair:
    """Detector of two networks; a recording's frames are to come in their order."""

    def __init__(self, first: Detector, second: Detector) -> None:
        self._first, self._second = first, second
        self._looked_from = dict[str, NDArray[np.float64]]()  # by camera

    @property
    def name(self) -> str:
        """Names of both."""
        return f"{self._first.name} and {self._second.name}"

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of both; () where those of one are unknown."""
        both = [tuple(getattr(one, "labels", ())) for one in (self._first, self._second)]
        return tuple(dict.fromkeys(both[0] + both[1])) if all(both) else ()

    @property
    def device(self) -> str:
        """Device of the first detector: "cpu", "cuda", ...; "" where it is no network."""
        return str(getattr(self._first, "device", ""))

    def resume(self, looked_from: Mapping[str, NDArray[np.float64]]) -> None:
        """Continue an earlier run, by the pose (4, 4) of the last frame of each network."""
        before = looked_from.get(self._second.name)
        self._looked_from = {} if before is None else {"": before}

    def detect(self, frame: Frame) -> Detections:
        """Detections of the first network, and of the second where the point of view is new."""
        found = [(self._first.name, self._first.detect(frame))]
        before = self._looked_from.get(frame.camera)
        if before is None or _is_new(before, frame.T_map_cam):
            self._looked_from[frame.camera] = frame.T_map_cam
            found.append((self._second.name, self._second.detect(frame)))
        return joined(found)


def _is_new(before: NDArray[np.float64], T_map_cam: NDArray[np.float64]) -> bool:
    distance, angle = motion(before, T_map_cam)
    return distance >= NEW_DISTANCE or angle >= NEW_ANGLE


def joined(found: list[tuple[str, Detections]]) -> Detections:
    """Detections of several detectors, given by name, of one image; best score first.

    Those of a pair keep the names of its networks.
    """
    xyxy = np.concatenate([one.xyxy for _, one in found])
    score = np.concatenate([one.score for _, one in found])
    label = [text for _, one in found for text in one.label]
    source = [text for name, one in found for text in one.source or (name,) * len(one)]
    masks = [mask for _, one in found for mask in one.mask or (None,) * len(one)]
    order = np.argsort(-score, kind="stable")
    return Detections(
        xyxy[order],
        score[order],
        tuple(label[int(i)] for i in order),
        tuple(source[int(i)] for i in order),
        tuple(text for name, one in found for text in one.detectors or (name,)),
        tuple(masks[int(i)] for i in order) if any(one.mask for _, one in found) else (),
    )


class RememberingDetector:
    """Detector that keeps the detections of another one in the first frames, by their ids."""

    def __init__(self, detector: Detector, max_frames: int = sys.maxsize) -> None:
        self._detector, self._max_frames = detector, max_frames
        self._found: dict[str, Detections] = {}

    @property
    def name(self) -> str:
        """Name of the other detector."""
        return self._detector.name

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the other detector; () where they are unknown."""
        return tuple(getattr(self._detector, "labels", ()))

    @property
    def device(self) -> str:
        """Device of the other detector; "" where it is no network."""
        return str(getattr(self._detector, "device", ""))

    def detect(self, frame: Frame) -> Detections:
        """Detections of `frame`, by the other detector where it is new."""
        known = self._found.get(frame.id)
        if known is not None:
            return known
        found = self._detector.detect(frame)
        if len(self._found) < self._max_frames:
            self._found[frame.id] = found
        return found
