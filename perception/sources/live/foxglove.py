"""Foxglove WebSocket servers: channels of ROS messages, and of Foxglove's own schemas.

Protocols foxglove.websocket.v1 and foxglove.sdk.v1: JSON for what there is and what is subscribed
to, binary frames for messages (opcode 1, subscription, time [ns], the message), and for calls of
services and their answers.
"""

from __future__ import annotations

import json
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final
from urllib.parse import urlsplit

from kg.model.errors import RecordingError, in_one_line
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
_CALL: Final = struct.Struct("<BIII")  # service, call, length of the encoding's name
_CALL_OPCODE, _ANSWER_OPCODE, _CDR = 2, 3, b"cdr"
_LATEST: Final = (1 << 63) - 1  # [ns]


@dataclass(frozen=True, slots=True)
class _Channel:
    id: int
    topic: str
    type: str
    encoding: str
    schema: str


class FoxgloveServices:
    """The services of a server, called through the connection that receives its messages."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}  # by name
        self._send: Callable[[bytes], None] | None = None  # None: not connected
        self._waiting: dict[int, Callable[[bytes | str], None]] = {}  # by the call's number
        self._last, self._lock = 0, threading.Lock()

    def has(self, name: str) -> bool:
        """Whether the server has a service now."""
        with self._lock:
            return self._send is not None and name in self._numbers

    def call(self, name: str, request: bytes, answered: Callable[[bytes | str], None]) -> None:
        """Call a service with a request in CDR; raises RecordingError where it is not there.

        The thread that receives passes `answered` the answer in CDR, or the reason of the failure.
        """
        with self._lock:
            if self._send is None or name not in self._numbers:
                raise RecordingError(f"the server has no service {name} now")
            self._last += 1
            self._waiting[self._last] = answered
            number, send, service = self._last, self._send, self._numbers[name]
        head = _CALL.pack(_CALL_OPCODE, service, number, len(_CDR))
        try:
            send(head + _CDR + request)
        except Exception as error:  # noqa: BLE001 - the connection broke off
            self._answer(number, in_one_line(error))

    def begin(self, send: Callable[[bytes], None] | None) -> None:
        """A connection begins; None: it has ended, and calls under way have failed."""
        with self._lock:
            self._send, self._numbers = send, {}
            failed, self._waiting = self._waiting, {}
        for answered in failed.values():
            answered("the connection broke off")

    def take(self, message: Any) -> None:
        """Take a JSON message of the server about services."""
        if message["op"] == "advertiseServices":
            found = {str(one["name"]): int(one["id"]) for one in message["services"]}
            with self._lock:
                self._numbers |= dict(list(found.items())[:MAX_CHANNELS])
        elif message["op"] == "unadvertiseServices":
            gone = set(map(int, message["serviceIds"]))
            with self._lock:
                self._numbers = {k: v for k, v in self._numbers.items() if v not in gone}
        elif message["op"] == "serviceCallFailure":
            self._answer(int(message["callId"]), str(message.get("message", "it failed")))

    def receive(self, data: bytes) -> None:
        """Take an answer."""
        _, _, number, size = _CALL.unpack_from(data)
        self._answer(number, bytes(data[_CALL.size + size :]))

    def _answer(self, number: int, answer: bytes | str) -> None:
        with self._lock:
            answered = self._waiting.pop(number, None)
        if answered is not None:
            answered(answer)


@dataclass(frozen=True, slots=True)
class FoxgloveConnection:
    """A connection to a Foxglove WebSocket server."""

    address: str  # ws://HOST:PORT or wss://HOST:PORT
    services: FoxgloveServices = field(default_factory=FoxgloveServices, compare=False)

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
                    self.services.begin(socket.send)
                    _Session(socket, inbox, retry, self.services).run(ended)
            except (OSError, EOFError, WebSocketException, RecordingError) as error:
                self.services.begin(None)
                retry.failed(error)


class _Session:
    """One connection: the channels it advertises, and what is subscribed to."""

    def __init__(self, socket: Any, inbox: Inbox, retry: Retry, services: FoxgloveServices) -> None:
        self._socket, self._inbox, self._retry, self._services = socket, inbox, retry, services
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
            else:
                self._services.take(message)
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
        if len(data) >= _CALL.size and data[0] == _ANSWER_OPCODE:
            self._services.receive(data)
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
