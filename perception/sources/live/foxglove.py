"""Foxglove WebSocket servers: channels of ROS messages, and of Foxglove's own schemas.

Protocols foxglove.websocket.v1 and foxglove.sdk.v1: JSON for what there is and what is subscribed
to, binary frames for messages (opcode 1, subscription, time [ns], the message).
"""

from __future__ import annotations

import json
import struct
import threading
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live.connection import MAX_IMAGE, Inbox, Retry, max_size
from perception.sources.ros.foxglove_schemas import ENCODINGS as FOXGLOVE
from perception.sources.ros.foxglove_schemas import ros_type

PROTOCOLS: Final = ("foxglove.sdk.v1", "foxglove.websocket.v1")
ENCODINGS: Final = ("ros1", "cdr", *FOXGLOVE)
MAX_CHANNELS: Final = 10_000
PATIENCE: Final = 5.0  # [s] for a connection
TICK: Final = 0.2  # [s]
_MESSAGE: Final = struct.Struct("<BIQ")
_LATEST: Final = (1 << 63) - 1  # [ns]


@dataclass(frozen=True, slots=True)
class _Channel:
    id: int
    topic: str
    type: str
    encoding: str
    schema: str


@dataclass(frozen=True, slots=True)
class FoxgloveConnection:
    """A connection to a Foxglove WebSocket server."""

    address: str  # ws://HOST:PORT or wss://HOST:PORT

    @classmethod
    def at(cls, address: str) -> FoxgloveConnection:
        """The server at an address; raises RecordingError."""
        try:
            parts = urlsplit(address)
            known = bool(parts.hostname) and parts.port != 0
        except ValueError:
            known = False
        if not known:
            raise RecordingError(f"{address!r} is no address; ws://localhost:8765 is one")
        return cls(address)

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Pass messages to `inbox` until `ended`."""
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        retry = Retry(self.address, ended)
        protocols = [Subprotocol(name) for name in PROTOCOLS]
        while not ended.is_set():
            try:
                with connect(
                    self.address,
                    subprotocols=protocols,
                    compression=None,
                    max_size=MAX_IMAGE + _MESSAGE.size,
                    open_timeout=PATIENCE,
                    close_timeout=1,
                ) as socket:
                    _Session(socket, inbox, retry).run(ended)
            except (OSError, EOFError, WebSocketException, RecordingError) as error:
                retry.failed(error)


class _Session:
    """One connection: the channels it advertises, and what is subscribed to."""

    def __init__(self, socket: Any, inbox: Inbox, retry: Retry) -> None:
        self._socket, self._inbox, self._retry = socket, inbox, retry
        self._channels: dict[int, _Channel] = {}
        self._subscribed: dict[int, _Channel] = {}  # by the subscription's number
        self._last = 0

    def run(self, ended: threading.Event) -> None:
        """Receive until `ended`; raises WebSocketException where the connection breaks off."""
        while not ended.is_set():
            try:
                data = self._socket.recv(timeout=TICK)
            except TimeoutError:
                self._subscribe()
                continue
            if isinstance(data, str):
                self._take_json(data)
                self._subscribe()
            else:
                self._received(data)

    def _take_json(self, text: str) -> None:
        try:
            message = json.loads(text)
            kind = message["op"]
            if kind == "advertise":
                for channel in message["channels"]:
                    self._advertised(channel)
            elif kind == "unadvertise":
                gone = set(map(int, message["channelIds"]))
                self._channels = {k: v for k, v in self._channels.items() if k not in gone}
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            raise RecordingError(f"malformed JSON of the server: {error}") from error

    def _advertised(self, channel: Any) -> None:
        if channel["encoding"] in ENCODINGS and len(self._channels) < MAX_CHANNELS:
            number, schema = int(channel["id"]), str(channel["schemaName"])
            names = str(channel["topic"]), ros_type(schema), str(channel["encoding"]), schema
            self._channels[number] = _Channel(number, *names)

    def _subscribe(self) -> None:
        """Subscribe to what is wanted now, and to nothing else."""
        topics = self._inbox.wanted({c.topic: c.type for c in self._channels.values()})
        wanted = {c.id: c for c in self._channels.values() if c.topic in topics}
        for number, channel in list(self._subscribed.items()):
            if wanted.pop(channel.id, None) != channel:
                del self._subscribed[number]
                self._send({"op": "unsubscribe", "subscriptionIds": [number]})
        for channel in wanted.values():
            self._last += 1
            self._subscribed[self._last] = channel
            subscription = {"id": self._last, "channelId": channel.id}
            self._send({"op": "subscribe", "subscriptions": [subscription]})

    def _send(self, message: dict[str, Any]) -> None:
        self._socket.send(json.dumps(message))

    def _received(self, data: bytes) -> None:
        if len(data) < _MESSAGE.size or data[0] != 1:
            return  # a message of another kind, such as the time
        _, number, stamp = _MESSAGE.unpack_from(data)
        channel = self._subscribed.get(number)
        if channel is None or len(data) - _MESSAGE.size > max_size(channel.type):
            return
        self._retry.worked()
        raw = RawMessage(
            channel.topic,
            channel.type,
            min(stamp, _LATEST),
            bytes(data[_MESSAGE.size :]),
            channel.encoding,
            channel.schema,
        )
        self._inbox.offer(raw, is_ros1=channel.encoding == "ros1")
