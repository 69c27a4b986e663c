"""Counts of a live stream's images, and why it gives no frames.

The reason is which of its images or poses have dried up, and since when.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Final

from kg.model.errors import RecordingError
from perception.sources.bags.bag import Choice
from perception.sources.bags.bag_index import Stream
from perception.sources.live.topic_detector import TopicDetector

DRY: Final = 5.0  # [s] without a frame after which the reason is told, ...
SLOW: Final = 4.0  # ... or as many times the usual time between two frames


@dataclass(frozen=True, slots=True)
class Silence:
    """A reason for which no frames come."""

    what: str  # what is missing: the same for one outage
    line: str  # the reason, for people


@dataclass(slots=True)
class StreamCounts:
    """Counts of the received colour images, by their use."""

    received: int = 0
    taken: int = 0  # given to be mapped
    without_depth: int = 0  # within the tolerance
    without_pose: int = 0
    unreadable: int = 0  # images that cannot be decoded, or change their size

    @property
    def dropped(self) -> int:
        """Images that newer ones replaced while an earlier one was mapped, and unused last ones."""
        lost = self.without_depth + self.without_pose + self.unreadable
        return self.received - self.taken - lost


@dataclass(slots=True)
class Arrivals:
    """When images of each topic came last, and their stamps."""

    came: dict[str, float] = field(default_factory=dict)  # [s] of time.monotonic()
    stamps: dict[str, float] = field(default_factory=dict)  # [s]

    def add(self, topic: str, stamp: float) -> None:
        """An image of a topic came, with its stamp [s]."""
        self.came[topic], self.stamps[topic] = time.monotonic(), stamp

    def silence(
        self, choice: Choice, tolerance: float, detections: TopicDetector | None = None
    ) -> Silence | None:
        """Why there is no frame of a choice now; None where images, detections and poses come."""
        for kind, stream in (("colour", choice.colour), ("depth", choice.depth)):
            silent = time.monotonic() - self.came.get(stream.topic, 0.0)
            if silent > DRY:
                return Silence(
                    stream.topic, f"no {kind} images of {stream.topic} for {silent:.0f} s"
                )
        newest = self.stamps[choice.colour.topic]
        if detections is not None and (found := self._undetected(detections, newest)):
            return found
        apart = abs(newest - self.stamps[choice.depth.topic])
        unposed = _unposed(choice, choice.colour, newest)
        if unposed is None and apart > max(tolerance, 1.0):
            line = f"stamps of colour and depth are {apart:.3g} s apart (--tolerance {tolerance:g})"
            return Silence("stamps", line)
        return unposed

    def _undetected(self, detections: TopicDetector, newest: float) -> Silence | None:
        """Why there are no detections of the image with the stamp `newest` [s]."""
        topic = detections.topic
        silent = time.monotonic() - self.came.get(topic, 0.0)
        if topic not in self.came:
            return Silence(topic, f"no detections of {topic} so far")
        if silent > DRY:
            return Silence(topic, f"no detections of {topic} for {silent:.0f} s")
        if abs(self.stamps[topic] - newest) > DRY:
            apart = self.stamps[topic] - newest
            line = f"stamps of {topic} and of the images are {apart:+.1f} s apart; "
            return Silence(topic, line + "detections need the stamp of their image")
        return None


def _unposed(choice: Choice, colour: Stream, newest: float) -> Silence | None:
    """Why there is no pose at the stamp `newest` [s] of colour."""
    if choice.poses is None:
        return None
    tree, name = choice.poses.tree, choice.poses.map_frame
    source = "tf" if choice.poses.topic is None else choice.poses.topic.topic
    try:
        last = tree.last_link(name, colour.frame)
    except RecordingError as error:
        return Silence("poses", f"no poses: {error}")
    if last is None or last[2] >= newest:
        return None
    parent, child, stamp = last
    return Silence(
        "poses",
        f"no poses: the last transform of {child} in {parent} ({source}) is {newest - stamp:.1f} s "
        f"older than the newest image, at {stamp:.3f}",
    )


class SilenceTeller:
    """Tells once when frames dry up, and once when they return."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._usual = 0.0  # [s] between two frames
        self._told = ""
        self._first = True  # whether no frame came yet

    def restart(self) -> None:
        """Frames are expected from now on."""
        self._last = time.monotonic()

    def frame(self) -> str:
        """A frame came; returns the line to tell, or ""."""
        now = time.monotonic()
        gap, self._last, told, self._told = now - self._last, now, self._told, ""
        first, self._first = self._first, False
        if first or not told:
            self._usual = gap if not self._usual else 0.8 * self._usual + 0.2 * gap
            return ""
        return f"frames come again, after {gap:.0f} s"

    @property
    def is_long(self) -> bool:
        """Whether frames have been missing for long enough to tell why."""
        return time.monotonic() - self._last >= max(DRY, SLOW * self._usual)

    def silent(self, silence: Silence | None) -> str:
        """No frame came, for a reason if any; returns the line to tell, or ""."""
        if silence is None or silence.what == self._told:
            return ""
        self._told = silence.what
        return f"no frames: {silence.line}"
