"""Selection of a recording's frames: key frames, every n-th, some seconds of it, the first few."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from kg.errors import RecordingError
from perception.camera.poses import motion
from perception.recordings.listing import FrameEntry

KEYFRAME_DISTANCE: Final = 0.1  # [m] of the camera from the last key frame ...
KEYFRAME_ANGLE: Final = math.radians(5)  # ... or of its orientation, that make a key frame


@dataclass(frozen=True, slots=True)
class Selection:
    """Which frames of a recording are read; by default all."""

    every: int = 1  # of the frames between `start` and `stop` the first, and each n-th after it
    limit: int | None = None  # at most so many
    start: float | None = None  # [s] after the recording's first frame
    stop: float | None = None  # [s] after it
    keyframes: bool = False  # only those whose camera has moved since the one before

    def of(self, entries: Sequence[FrameEntry], name: str) -> tuple[FrameEntry, ...]:
        """The selected entries; raises RecordingError where there is none."""
        if not entries:
            raise RecordingError(f"{name} has no frames")
        first = entries[0].stamp
        between = [
            entry
            for entry in entries
            if (self.start is None or entry.stamp - first >= self.start)
            and (self.stop is None or entry.stamp - first <= self.stop)
        ]
        if self.keyframes:
            between = keyframes(between)
        chosen = tuple(between[:: self.every])[: self.limit]
        if not chosen:
            raise RecordingError(
                f"{name}: no frames selected; its {len(entries)} frames last "
                f"{entries[-1].stamp - first:.2f} s"
            )
        return chosen


def keyframes(entries: Sequence[FrameEntry]) -> list[FrameEntry]:
    """The first entry, and each whose camera has moved or turned since the one before of these."""
    chosen: list[FrameEntry] = []
    for entry in entries:
        if chosen:
            distance, angle = motion(chosen[-1].T_world_cam, entry.T_world_cam)
            if distance < KEYFRAME_DISTANCE and angle < KEYFRAME_ANGLE:
                continue
        chosen.append(entry)
    return chosen
