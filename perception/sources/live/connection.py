"""Connections to publishers of messages, the inboxes that receive them, and their images."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import HereaboutsError, RecordingError, in_one_line
from kg.model.extensions import CONNECTIONS, load_extension
from perception.camera.image_decoding import metres
from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.bags.bag_index import WITH_IMAGES
from perception.sources.ros.image_messages import NANOSECONDS, colour_image, depth_image

MIN_PAUSE: Final = 0.5  # [s] before a broken connection is tried again; doubled each time, ...
MAX_PAUSE: Final = 10.0  # ... up to this
MAX_IMAGE: Final = 1 << 27  # [bytes] of a message with an image
MAX_OTHER: Final = 1 << 20  # ... of any other message
MAX_WARNINGS: Final = 100  # warnings of one source

_log = logging.getLogger(__name__)


class Inbox(Protocol):
    """Receiver of a connection's messages; called from any thread."""

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Those of `topics` (name -> type, e.g. sensor_msgs/msg/Image) to subscribe to."""

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Receive a message, serialised as ROS 1 or as ROS 2 does."""


class Connection(Protocol):
    """A source of messages."""

    @property
    def address(self) -> str:
        """Address of the source, for people."""

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Pass messages to `inbox` until `ended`; reconnects where the connection breaks off.

        It returns before that at the end of a file that is played.
        """


Wanted = Callable[[Mapping[str, str]], set[str]]
Offer = Callable[[str, str, int, bytes], None]


class ExtensionConnection(Protocol):
    """Connection of an entry point of `hereabouts.connections`, for an address such as ``zmq://HOST``.

    `wanted` takes the topics that there are, name -> type such as sensor_msgs/msg/Image, and
    returns those that are used. `offer` takes topic, type, time [ns] and the message as ROS 2
    serialises it (CDR); any thread may call it. `run` returns once `ended` is set, or at the end of
    what is played.
    """

    def run(self, wanted: Wanted, offer: Offer, ended: threading.Event) -> None:
        """Offer messages until `ended` is set."""


@dataclass(frozen=True, slots=True)
class AddedConnection:
    """A connection of an extension; `run` raises RecordingError where the extension fails."""

    address: str
    own: Any

    @classmethod
    def at(cls, address: str) -> AddedConnection:
        """The connection to an address whose scheme an extension has added."""
        opened: Any = load_extension(CONNECTIONS, address.partition("://")[0], object)
        try:
            own = opened(address)
        except Exception as error:
            raise _failed(address, error) from error
        if not callable(getattr(own, "run", None)):
            raise RecordingError(f"{address}: its extension gives no connection with `run`")
        return cls(address, own)

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Pass messages to `inbox` until `ended`."""

        def offer(topic: str, kind: str, time: int, data: bytes) -> None:
            inbox.offer(RawMessage(topic, kind, time, data, "cdr"), is_ros1=False)

        try:
            self.own.run(inbox.wanted, offer, ended)
        except Exception as error:
            raise _failed(self.address, error) from error


def _failed(address: str, error: Exception) -> HereaboutsError:
    if isinstance(error, HereaboutsError):
        return error
    return RecordingError(f"{address}: {in_one_line(error)}")


def max_size(type_: str) -> int:
    """Size [bytes] above which a message of that type is refused."""
    return MAX_IMAGE if type_ in WITH_IMAGES else MAX_OTHER


class Retry:
    """Pauses between attempts to connect, each twice as long as the one before.

    Each failure gives one warning. Connections to one peer share the set `warned`, so that a
    failure of all of them gives one warning too.
    """

    def __init__(
        self, where: str, ended: threading.Event, warned: set[tuple[str, str]] | None = None
    ) -> None:
        self._where, self._ended = where, ended
        self._warned = set[tuple[str, str]]() if warned is None else warned
        self._pauses, self._failing = _pauses(), False

    def failed(self, error: object) -> None:
        """Warn of the error, and wait."""
        reason = in_one_line(error)[:200]
        if (self._where, reason) not in self._warned and len(self._warned) < MAX_WARNINGS:
            _log.warning("%s: %s; trying again", self._where, reason)
            self._warned.add((self._where, reason))
        self._failing = True
        self.wait()

    def wait(self) -> None:
        """Wait; each time twice as long, up to MAX_PAUSE."""
        self._ended.wait(next(self._pauses))

    def worked(self) -> None:
        """Start again with MIN_PAUSE."""
        if self._failing:
            self._pauses, self._failing = _pauses(), False


def _pauses() -> Iterator[float]:
    pause = MIN_PAUSE
    while True:
        yield pause
        pause = min(2 * pause, MAX_PAUSE)


HELD: Final = 256  # messages of a topic that wait, ...
HELD_BYTES: Final = 1 << 27  # ... and their size [bytes]


@dataclass(frozen=True, slots=True)
class LiveDecoder:
    """Decoder of the messages of one connection."""

    address: str
    is_ros1: bool

    def decoded(self, raw: RawMessage) -> Any:
        """The message with its fields; raises RecordingError."""
        return decoded(raw, self.is_ros1, self.address)


@dataclass(frozen=True, slots=True)
class LiveImage:
    """An image that came as a message."""

    raw: RawMessage
    decoder: LiveDecoder
    stamp: int  # [ns]
    came: float  # [s] of time.monotonic()

    def __str__(self) -> str:
        return f"{self.decoder.address}, {self.raw.topic} at {self.id}"

    @property
    def id(self) -> str:
        """Its stamp as text."""
        return f"{self.stamp // NANOSECONDS}.{self.stamp % NANOSECONDS:09d}"

    @property
    def seconds(self) -> float:
        """Its stamp [s]."""
        return self.stamp / NANOSECONDS

    def check(self) -> None:
        """Nothing: a message has come whole or not at all."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return colour_image(self.decoder.decoded(self.raw), str(self))

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a metre] is that of 16-bit images."""
        return metres(depth_image(self.decoder.decoded(self.raw), str(self)), depth_scale)


class HeldImages:
    """The latest images of a topic, bounded in number and size."""

    def __init__(self) -> None:
        self.images = deque[LiveImage]()
        self.size = 0  # [bytes]

    def add(self, image: LiveImage) -> None:
        """Add one; the first go where they become too many, and all where time went back."""
        if self.images and image.stamp < self.images[-1].stamp - NANOSECONDS:
            self.images.clear()
            self.size = 0
        self.images.append(image)
        self.size += len(image.raw.data)
        while len(self.images) > 1 and (len(self.images) > HELD or self.size > HELD_BYTES):
            self.drop(self.images[0])

    def drop(self, image: LiveImage) -> None:
        """Drop one."""
        self.images.remove(image)
        self.size -= len(image.raw.data)

    def drop_unpaired(self, others: HeldImages, tolerance: float) -> int:
        """Drop images older than the newest of `others` that have none within `tolerance` [s].

        Returns their number.
        """
        if not others.images:
            return 0
        near, before = others.seconds, len(self.images)
        passed = near.max() - tolerance
        for image in list(self.images):
            if image.seconds < passed and np.abs(near - image.seconds).min() > tolerance:
                self.drop(image)
        return before - len(self.images)

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Stamps [s] (n,)."""
        return np.array([image.seconds for image in self.images])
