"""Selection of a recording's frames: every n-th, some seconds of it, the first few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kg.errors import RecordingError
from perception.recordings.listing import FrameEntry


@dataclass(frozen=True, slots=True)
class Selection:
    """Which frames of a recording are read; by default all."""

    every: int = 1  # of the frames between `start` and `stop` the first, and each n-th after it
    limit: int | None = None  # at most so many
    start: float | None = None  # [s] after the recording's first frame
    stop: float | None = None  # [s] after it

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
        chosen = tuple(between[:: self.every])[: self.limit]
        if not chosen:
            raise RecordingError(
                f"{name}: no frames selected; its {len(entries)} frames last "
                f"{entries[-1].stamp - first:.2f} s"
            )
        return chosen
