"""Remembered detections: a detector that runs once on each frame, and then repeats itself."""

from __future__ import annotations

from perception.frames import Detections, Detector, Frame


class RememberingDetector:
    """Detector that keeps what another one found in the first `most` frames, by their ids."""

    def __init__(self, detector: Detector, most: int) -> None:
        self._detector, self._most = detector, most
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
        if len(self._found) < self._most:
            self._found[frame.id] = found
        return found
