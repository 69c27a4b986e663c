"""Several cameras of one live connection: one stream of their frames, which they give by turns.

Each camera has a `FrameStream` with topics, CameraInfo and poses of its own; all poses are in one
map frame. Where frames are mapped more slowly than they come, each camera gives the next one in its
turn, so that none waits for ever; and none comes more often than its own rate.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import astuple, replace
from itertools import combinations
from typing import Final

from kg.model.errors import RecordingError, did_you_mean
from perception.frames import Frame
from perception.sources.bags.bag import Choice
from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_index import CAMERA, IMAGES
from perception.sources.live.silence import StreamCounts
from perception.sources.live.stream import SILENT, TICK, FrameStream
from perception.sources.live.topic_detector import TopicDetector
from perception.sources.recording_options import RecordingOptions

ABSENT: Final = 5.0  # [s] from the first topic of images to that of the last camera

_WAYS: Final = "--camera takes a name in the topics of one camera, or its topic of colour images"


class CameraStreams:
    """The streams of several cameras; their frames have names of their camera.

    `cameras` are names in topics (/NAME/...), or topics of colour images, each perhaps with its
    frames a second at most (NAME@2). Of the `options` those of one camera do not count, and poses
    are not estimated. Raises RecordingError for a camera that is given twice, and for other rates.
    """

    def __init__(
        self,
        address: str,
        cameras: Sequence[str],
        options: RecordingOptions,
        detections: TopicDetector | None = None,
    ) -> None:
        self.address = address
        rates = [_named(text) for text in cameras]
        names, self._periods = [name for name, _ in rates], dict(rates)
        self._due = dict.fromkeys(names, 0.0)  # [s] when each may give its next frame
        for name in names:
            if names.count(name) > 1:
                raise RecordingError(f"camera {name} is given twice; each once would work")
        posed = replace(options, estimate_poses=False)
        each = {name: None if detections is None else detections.of(name) for name in names}
        self.cameras = tuple(
            FrameStream(address, _of(name, posed), theirs, camera=name)
            for name, theirs in each.items()
        )
        self._turns = deque(self.cameras)  # whose turn it is comes first
        self._images = set[str]()  # topics of images that there are
        self._seen = 0.0  # [s] when the first of them was there
        self._ready = 0.0  # [s] when the first camera was chosen
        self._chosen = 0  # cameras whose topics were compared
        self._begun = False

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics to subscribe to, for any camera."""
        self._images |= {name for name, type_ in topics.items() if type_ in IMAGES}
        if self._images:
            self._seen = self._seen or time.monotonic()
        found = set[str]()
        for one in self.cameras:
            found |= one.wanted({t: k for t, k in topics.items() if _may_be_of(one.camera, t, k)})
        return found

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a message, for each camera that it is of."""
        for one in self.cameras:
            if _may_be_of(one.camera, raw.topic, raw.type):
                one.offer(raw, is_ros1=is_ros1)

    def next_frame(self, seconds: float) -> Frame | None:
        """The newest whole frame of the camera whose turn it is, or of the next that has one.

        It is waited for up to `seconds`; None where none came. Raises RecordingError for a camera
        that there is not, or is one with another.
        """
        until = time.monotonic() + seconds
        while True:
            begun = self._begin()
            self._check_choices()
            for one in tuple(self._turns) if begun else ():
                is_due = time.monotonic() >= self._due[one.camera]
                frame = one.next_frame(0) if is_due else None
                if frame is not None:
                    self._due[one.camera] = time.monotonic() + self._periods[one.camera]
                    self._turns.remove(one)
                    self._turns.append(one)
                    return frame
            if time.monotonic() >= until:
                return None
            time.sleep(TICK)

    @property
    def counts(self) -> StreamCounts:
        """Counts of the images of all cameras."""
        each = (astuple(one.counts) for one in self.cameras)
        return StreamCounts(*(sum(part) for part in zip(*each, strict=True)))

    @property
    def choice(self) -> Choice | None:
        """The topics of the first camera that has chosen some; None before."""
        return next((choice for one in self.cameras if (choice := one.choice) is not None), None)

    @property
    def problem(self) -> str:
        """The reason why a camera has no frames yet; "" where all have."""
        found = (f"camera {one.camera}: {one.problem}" for one in self.cameras if one.problem)
        return next(found, "")

    @property
    def estimates(self) -> bool:
        """Whether poses are estimated from the images: never those of several cameras."""
        return False

    def _begin(self) -> bool:
        """Whether frames are given: all cameras are there, or the others were waited for."""
        if not self._begun:
            ready, now = [one.is_chosen() for one in self.cameras], time.monotonic()
            if self._all_there() and any(ready):
                self._ready = self._ready or now
                self._begun = all(ready) or now > self._ready + SILENT
        return self._begun

    def _all_there(self) -> bool:
        """Whether each camera has topics; raises RecordingError where one has none after ABSENT."""
        images = frozenset(self._images)
        absent = [n for n in (one.camera for one in self.cameras) if not _there(n, images)]
        if absent and self._seen and time.monotonic() > self._seen + ABSENT:
            name, colour = absent[0], sorted(t for t in images if "depth" not in t)
            parts = {part for topic in colour for part in (topic, *topic.split("/"))}
            raise RecordingError(
                f"{self.address}: there is no camera {name}{did_you_mean(name, sorted(parts))}; "
                f"{_WAYS}; there are: {', '.join(colour or sorted(images))}"
            )
        return not absent

    def _check_choices(self) -> None:
        """Raise RecordingError where two cameras share a topic, or have other map frames."""
        found = [(one.camera, choice) for one in self.cameras if (choice := one.choice) is not None]
        if len(found) == self._chosen:
            return
        self._chosen = len(found)
        for (a, one), (b, other) in combinations(found, 2):
            topics = [{choice.colour.topic, choice.depth.topic} for choice in (one, other)]
            if shared := topics[0] & topics[1]:
                raise RecordingError(f"cameras {a} and {b} are both of {min(shared)}; {_WAYS}")
            if one.map_frame != other.map_frame:
                raise RecordingError(
                    f"poses of camera {a} are in {one.map_frame}, those of camera {b} in "
                    f"{other.map_frame}; --map-frame names a frame that both have"
                )


def _named(text: str) -> tuple[str, float]:
    """A camera's name, and the time [s] between its frames at least, of NAME or NAME@RATE."""
    name, at, rate = text.partition("@")
    try:
        period = 1 / float(rate) if at else 0.0
        if not 0 <= period < math.inf:
            raise ValueError
    except (ValueError, ZeroDivisionError) as error:
        raise RecordingError(
            f"camera {text}: {name}@2, for 2 frames a second, would work"
        ) from error
    return name.rstrip("/"), period


def _there(camera: str, images: Collection[str]) -> bool:
    """Whether a camera has one of these topics of images."""
    return camera in images or any(f"/{camera}/" in topic for topic in images)


def _may_be_of(camera: str, topic: str, type_: str) -> bool:
    """Whether a camera may use a topic: no images and no CameraInfo of others, by its name."""
    is_named = not camera.startswith("/") and type_ in (*IMAGES, CAMERA)
    return not is_named or f"/{camera}/" in topic


def _of(name: str, options: RecordingOptions) -> RecordingOptions:
    """Options of one camera, by its topic of colour where that is its name."""
    colour = name if name.startswith("/") else None
    return replace(options, streams=replace(options.streams, colour=colour))
