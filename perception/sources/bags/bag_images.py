"""Images of a bag: messages that are decoded when they are asked for, in any order."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import metres
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.bags.bag_index import Stream
from perception.sources.ros.image_messages import NANOSECONDS, colour_image, depth_image

AHEAD: Final = 2 * NANOSECONDS  # [ns] further on in the bag is sought instead of read on to
HELD: Final = 1 << 26  # [bytes] of messages passed on the way that are kept, for the other stream


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image of a recording that is a message of a bag."""

    source: MessageSource
    topic: str
    time: int  # [ns] at which it was recorded
    ordinal: int  # which of the topic's messages of that time

    def __str__(self) -> str:
        return f"{self.source.path}, {self.topic} at {frame_id(self.time)}"

    def check(self) -> None:
        """Nothing: bags keep no checksum of a message."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return colour_image(self.source.message(self.topic, self.time, self.ordinal), str(self))

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a metre] is that of 16-bit images."""
        message = self.source.message(self.topic, self.time, self.ordinal)
        return metres(depth_image(message, str(self)), depth_scale)


def images_of(source: MessageSource, stream: Stream) -> list[BagImage]:
    """All images of a stream."""
    images: list[BagImage] = []
    for time in stream.times:
        same = bool(images) and images[-1].time == time
        images.append(BagImage(source, stream.topic, time, images[-1].ordinal + 1 if same else 0))
    return images


@dataclass(frozen=True, slots=True, eq=False)
class MessageSource:
    """Messages of a bag, in any order; fast in the order in which they were recorded."""

    path: Path
    topics: tuple[str, ...]
    _open: threading.local = field(default_factory=threading.local)  # a reader for each thread

    def message(self, topic: str, time: int, ordinal: int) -> Any:
        """The `ordinal`-th message of `topic` recorded at `time` [ns]."""
        if not hasattr(self._open, "tape"):
            self._open.tape = _Tape(BagFile(self.path), self.topics)
        return self._open.tape.message((topic, time, ordinal))


_Key = tuple[str, int, int]


class _Tape:
    """A bag read from message to message; messages passed on the way are kept for a while."""

    def __init__(self, bag: BagFile, topics: tuple[str, ...]) -> None:
        self._bag = bag
        self._topics = topics
        self._wind(None)

    def _wind(self, start: int | None) -> None:
        self._messages = self._bag.messages(self._topics, start)
        self._passed = OrderedDict[_Key, RawMessage]()
        self._held = 0  # [bytes]
        self._last: dict[str, tuple[int, int]] = {}
        self._now = start or 0

    def message(self, key: _Key) -> Any:
        raw = self._passed.pop(key, None)
        if raw is not None:
            self._held -= len(raw.data)
        else:
            if not self._now <= key[1] <= self._now + AHEAD:
                self._wind(key[1])
            raw = self._found(key)
        if raw is None:  # passed before, and not kept
            self._wind(key[1])
            raw = self._found(key)
        if raw is None:
            raise RecordingError(f"{self._bag.path}: a message of {key[0]} is gone")
        return self._bag.decoded(raw)

    def _found(self, key: _Key) -> RawMessage | None:
        for raw in self._messages:
            time, ordinal = self._last.get(raw.topic, (-1, 0))
            ordinal = ordinal + 1 if time == raw.time else 0
            self._last[raw.topic] = (raw.time, ordinal)
            self._now = raw.time
            found = (raw.topic, raw.time, ordinal)
            if found == key:
                return raw
            self._passed[found] = raw
            self._held += len(raw.data)
            while self._held > HELD:
                self._held -= len(self._passed.popitem(last=False)[1].data)
            if raw.time > key[1]:
                return None
        return None


def frame_id(stamp: int) -> str:
    """A stamp [ns] as the name of its frame."""
    return f"{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d}"
