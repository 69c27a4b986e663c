"""Connections of extensions: messages of topics, whatever transports them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from kg.model.errors import HereaboutsError, RecordingError
from kg.model.extensions import CONNECTIONS, load_extension
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live.connection import Inbox

Wanted = Callable[[Mapping[str, str]], set[str]]
Offer = Callable[[str, str, int, bytes], None]


class ExtensionConnection(Protocol):
    """What an entry point of `hereabouts.connections` returns for an address such as ``zmq://HOST``.

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
    reason = " ".join(str(error).split()) or type(error).__name__
    return RecordingError(f"{address}: {reason}")
