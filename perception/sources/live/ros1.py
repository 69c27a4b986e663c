"""ROS 1: topics of a master, without ROS.

The master's XML-RPC API (wiki.ros.org: Master_API, Slave_API) names the nodes that publish a topic;
each node is asked for a TCPROS connection. The subscription is not registered with the master, so
that nothing has to be served; publishers see it.

TCPROS (wiki.ros.org: ROS/TCPROS): a header of `key=value` fields, then messages, each with its
length before it, in 4 bytes, little-endian.
"""

from __future__ import annotations

import http.client
import math
import os
import socket
import struct
import threading
import time
import xmlrpc.client
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live.connection import Inbox, Retry, max_size
from perception.sources.ros.foxglove_schemas import ros_type

CALLER: Final = "/hereabouts"
PATIENCE: Final = 5.0  # [s] for an answer
MAX_ANSWER: Final = 1 << 24  # [bytes] of the master or a node

#: errors of a request to a master, a node, or another program at its address
FAILURES: Final = (
    OSError,
    xmlrpc.client.Error,
    http.client.HTTPException,
    ExpatError,
    RecordingError,
    ValueError,  # among them those of wrong types and encodings
    TypeError,
    LookupError,
    OverflowError,
)


def ask(uri: str, method: str, *arguments: Any, caller: str) -> Any:
    """Answer of a master or a node; raises one of FAILURES."""
    with xmlrpc.client.ServerProxy(uri, transport=_Transport()) as proxy:
        answer = getattr(proxy, method)(caller, *arguments)
    if not (isinstance(answer, list) and len(answer) == 3):
        raise RecordingError(f"{method}: answered by what is no ROS 1 master or node")
    code, said, value = answer
    if code != 1:
        raise RecordingError(f"{method} failed: {said}")
    return value


class _Transport(xmlrpc.client.Transport):
    """HTTP with a time limit, and answers of limited size."""

    accept_gzip_encoding = False

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = http.client.HTTPConnection(str(host), timeout=PATIENCE)
        self._connection = host, connection  # what `close` closes
        return connection

    def parse_response(self, response: Any) -> Any:
        data = response.read(MAX_ANSWER + 1)
        if len(data) > MAX_ANSWER:
            raise RecordingError(f"an answer of more than {MAX_ANSWER} bytes")
        parser, unmarshaller = self.getparser()
        parser.feed(data)
        parser.close()
        return unmarshaller.close()


TICK: Final = 0.5  # [s] after which a silent connection checks whether it is still wanted
HEADER_WITHIN: Final = 5.0  # [s]
MAX_HEADER: Final = 1 << 20  # [bytes]; it has the message's definition


@dataclass(frozen=True, slots=True)
class TcprosConnection:
    """TCPROS connection over an open socket; reading ends once `ended` is set."""

    connected: socket.socket
    name: str  # of the topic or node, for messages
    ended: threading.Event

    def __post_init__(self) -> None:
        self.connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.connected.settimeout(TICK)

    def block(self, bound: int, within: float = math.inf) -> bytes | None:
        """The next block of data; None once either side has ended the connection.

        Raises RecordingError for more than `bound` [bytes], OSError where the connection breaks
        off or the block is not complete after `within` [s].
        """
        until = time.monotonic() + within
        length = self._exactly(4, until, may_end=True)
        if length is None:
            return None
        (size,) = struct.unpack("<I", length)
        if size > bound:
            raise RecordingError(f"{self.name}: a message of {size} bytes; up to {bound} are taken")
        return self._exactly(size, until)

    def _exactly(self, size: int, until: float, *, may_end: bool = False) -> bytes | None:
        parts, missing = list[bytes](), size
        while missing:
            if self.ended.is_set():
                return None
            if time.monotonic() > until:
                raise TimeoutError(f"{self.name}: the other side is silent")
            try:
                part = self.connected.recv(min(missing, 1 << 20))
            except TimeoutError:
                continue
            if not part and may_end and missing == size:
                return None
            if not part:
                raise ConnectionError("the other side closed the connection")
            parts.append(part)
            missing -= len(part)
        return b"".join(parts)

    def fields(self) -> dict[str, str]:
        """Fields of the other side's header; raises RecordingError where it is malformed."""
        header, at = self.block(MAX_HEADER, HEADER_WITHIN) or b"", 0
        fields = dict[str, str]()
        while at < len(header):
            size = struct.unpack_from("<I", header, at)[0] if at + 4 <= len(header) else len(header)
            line = header[at + 4 : at + 4 + size]
            if len(line) < size:
                raise RecordingError(f"{self.name}: the other side's header is malformed")
            key, _, value = line.decode("utf-8", "replace").partition("=")
            fields[key] = value
            at += 4 + size
        return fields

    def send_fields(self, fields: Mapping[str, str]) -> None:
        """Send a header."""
        lines = [f"{key}={value}".encode() for key, value in fields.items()]
        self.connected.sendall(block(b"".join(map(block, lines))))


def block(data: bytes) -> bytes:
    """`data` with its length before it."""
    return struct.pack("<I", len(data)) + data


PORT: Final = 11311
POLL: Final = 0.2  # [s] between two requests to the master
MAX_SUBSCRIPTIONS: Final = 100

_Key = tuple[str, str, str]  # topic, type as the publisher names it, node


@dataclass(frozen=True, slots=True)
class Ros1Master:
    """A ROS 1 master, and all that publishes through it."""

    host: str
    port: int
    caller: str = CALLER  # our own name among its nodes

    @classmethod
    def at(cls, address: str) -> Ros1Master:
        """The master at ros1://HOST[:PORT], or "ros1": that of ROS_MASTER_URI, else at localhost.

        Raises RecordingError for anything else.
        """
        if address == "ros1":
            address = os.environ.get("ROS_MASTER_URI") or "ros1://localhost"
        try:
            parts = urlsplit(address)
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if not host:
            raise RecordingError(f"{address!r} is no ROS 1 master; ros1://localhost:{PORT} is one")
        return cls(host, port or PORT)

    @property
    def address(self) -> str:
        """Its address, for messages."""
        return f"ros1://{self.host}:{self.port}"

    @property
    def uri(self) -> str:
        """Address of its XML-RPC API."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/"

    def ask(self, method: str, *arguments: Any) -> Any:
        """Answer of its XML-RPC API; raises one of FAILURES."""
        return ask(self.uri, method, *arguments, caller=self.caller)

    def publisher(self, types: Mapping[str, str], latched: frozenset[str] = frozenset()) -> Any:
        """A `Ros1Publisher` of this master."""
        from perception.sources.live.ros1_publisher import Ros1Publisher

        return Ros1Publisher(self, types, latched)

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Pass messages to `inbox` until `ended`."""
        retry = Retry(self.address, ended)
        running: dict[_Key, _Subscription] = {}
        warned = set[tuple[str, str]]()
        while not ended.is_set():
            try:
                wanted = _publishers(self, inbox)
            except FAILURES as error:
                retry.failed(error)
                continue
            retry.worked()
            for key in running.keys() - wanted:
                running.pop(key).close()
            for key in sorted(wanted - running.keys())[: MAX_SUBSCRIPTIONS - len(running)]:
                running[key] = _Subscription(self, key, inbox, warned)
            ended.wait(POLL)
        for one in running.values():
            one.close()


def _publishers(master: Ros1Master, inbox: Inbox) -> set[_Key]:
    """Topics to subscribe to, with the nodes that publish them now."""
    types = {str(topic): str(type_) for topic, type_ in master.ask("getTopicTypes")}
    publishers, *_ = master.ask("getSystemState")
    nodes = {str(topic): [str(node) for node in names] for topic, names in publishers}
    full = {topic: ros_type(type_) for topic, type_ in types.items() if nodes.get(topic)}
    return {(topic, types[topic], node) for topic in inbox.wanted(full) for node in nodes[topic]}


class _Subscription:
    """A topic of one publisher, received by a thread of its own."""

    def __init__(
        self, master: Ros1Master, key: _Key, inbox: Inbox, warned: set[tuple[str, str]]
    ) -> None:
        self._master, self._inbox, self._warned = master, inbox, warned
        self._topic, self._type, self._node = key
        self._ended = threading.Event()
        threading.Thread(target=self._run, name=f"ros1 {self._topic}", daemon=True).start()

    def close(self) -> None:
        """End it; its thread ends at its next check."""
        self._ended.set()

    def _run(self) -> None:
        retry = Retry(self._node, self._ended, self._warned)
        while not self._ended.is_set():
            try:
                for data in self._messages():
                    retry.worked()
                    raw = RawMessage(self._topic, ros_type(self._type), time.time_ns(), data)
                    self._inbox.offer(raw, is_ros1=True)
                retry.wait()  # an orderly end: the node leaves, and the master will know
            except FAILURES as error:
                retry.failed(error)

    def _messages(self) -> Iterator[bytes]:
        """Messages until `close`; raises one of FAILURES where the connection breaks off."""
        caller = self._master.caller
        node = str(self._master.ask("lookupNode", self._node))
        protocol = ask(node, "requestTopic", self._topic, [["TCPROS"]], caller=caller)
        if protocol[0] != "TCPROS":
            raise RecordingError(f"no TCPROS, but {str(protocol)[:80]}")
        with socket.create_connection((str(protocol[1]), int(protocol[2])), PATIENCE) as connected:
            connection = TcprosConnection(connected, self._topic, self._ended)
            connection.send_fields(
                {
                    "callerid": caller,
                    "topic": self._topic,
                    "type": self._type,
                    "md5sum": "*",  # any version of the message
                    "tcp_nodelay": "1",
                }
            )
            fields = connection.fields()
            if "error" in fields:
                raise RecordingError(f"{self._topic}: refused: {fields['error']}")
            if fields.get("type") != self._type:
                was = f"{fields.get('type')}, not {self._type}"
                raise RecordingError(f"{self._topic} has messages of {was}")
            bound = max_size(ros_type(self._type))
            while (data := connection.block(bound)) is not None:
                yield data
