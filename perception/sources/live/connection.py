"""Connections to publishers of messages, and the inboxes that receive the messages."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Mapping
from typing import Final, Protocol

from perception.sources.bags.bag_file import RawMessage
from perception.sources.bags.bag_index import IMAGES

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


def max_size(type_: str) -> int:
    """Size [bytes] above which a message of that type is refused."""
    return MAX_IMAGE if type_ in IMAGES else MAX_OTHER


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
        reason = " ".join(str(error).split())[:200] or type(error).__name__
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
