"""ROS 1: topics of a master, without ROS.

The master's XML-RPC API names the nodes that publish a topic; each node is asked for a TCPROS
connection, which begins with a header of `key=value` fields and goes on with messages, all of them
behind their length in 4 bytes, little-endian (wiki.ros.org: Master_API, Slave_API, TCPROS). The
subscription is not registered with the master, so that nothing has to be served; publishers see it.
"""

from __future__ import annotations

import http.client
import socket
import struct
import threading
import time
import xmlrpc.client
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from kg.errors import RecordingError
from perception.live.connection import Inbox, Retry, full_name, largest
from perception.recordings.bag_file import RawMessage

PORT: Final = 11311
CALLER: Final = "/hereabouts"
POLL: Final = 0.2  # [s] between two looks at the master
PATIENCE: Final = 5.0  # [s] for an answer
TICK: Final = 0.5  # [s] after which a silent connection looks whether it is still wanted
LARGEST_HEADER: Final = 1 << 20  # [bytes]; it has the message's definition
LARGEST_ANSWER: Final = 1 << 24  # [bytes] of the master or a node
MOST_SUBSCRIPTIONS: Final = 100

#: what a master, a node or something else at its address may make of a request
_FAILURES: Final = (
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
_Key = tuple[str, str, str]  # topic, type as the publisher names it, node


@dataclass(frozen=True, slots=True)
class Ros1Master:
    """A ROS 1 master, and all that publishes through it."""

    host: str
    port: int

    @classmethod
    def at(cls, address: str) -> Ros1Master:
        """The master at ros1://HOST[:PORT]; raises RecordingError."""
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
        """Where it is, for people."""
        return f"ros1://{self.host}:{self.port}"

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Give what comes to `inbox` until `ended`."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        uri = f"http://{host}:{self.port}/"
        retry = Retry(self.address, ended)
        running: dict[_Key, _Subscription] = {}
        said = set[tuple[str, str]]()
        while not ended.is_set():
            try:
                wanted = _publishers(uri, inbox)
            except _FAILURES as error:
                retry.failed(error)
                continue
            retry.worked()
            for key in running.keys() - wanted:
                running.pop(key).close()
            for key in sorted(wanted - running.keys())[: MOST_SUBSCRIPTIONS - len(running)]:
                running[key] = _Subscription(uri, key, inbox, said)
            ended.wait(POLL)
        for one in running.values():
            one.close()


def _publishers(uri: str, inbox: Inbox) -> set[_Key]:
    """Topics to subscribe to, with the nodes that publish them now."""
    types = {str(topic): str(type_) for topic, type_ in _ask(uri, "getTopicTypes")}
    publishers, *_ = _ask(uri, "getSystemState")
    nodes = {str(topic): [str(node) for node in names] for topic, names in publishers}
    full = {topic: full_name(type_) for topic, type_ in types.items() if nodes.get(topic)}
    return {(topic, types[topic], node) for topic in inbox.wanted(full) for node in nodes[topic]}


def _ask(uri: str, method: str, *arguments: Any) -> Any:
    """Answer of a master or a node; raises one of _FAILURES."""
    with xmlrpc.client.ServerProxy(uri, transport=_Transport()) as proxy:
        code, said, answer = getattr(proxy, method)(CALLER, *arguments)
    if code != 1:
        raise RecordingError(f"{method} failed: {said}")
    return answer


class _Transport(xmlrpc.client.Transport):
    """HTTP with a time limit, and answers of limited size."""

    accept_gzip_encoding = False

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = http.client.HTTPConnection(str(host), timeout=PATIENCE)
        self._connection = host, connection  # what `close` closes
        return connection

    def parse_response(self, response: Any) -> Any:
        data = response.read(LARGEST_ANSWER + 1)
        if len(data) > LARGEST_ANSWER:
            raise RecordingError(f"an answer of more than {LARGEST_ANSWER} bytes")
        parser, unmarshaller = self.getparser()
        parser.feed(data)
        parser.close()
        return unmarshaller.close()


class _Subscription:
    """A topic of one publisher, received by a thread of its own."""

    def __init__(self, master: str, key: _Key, inbox: Inbox, said: set[tuple[str, str]]) -> None:
        self._master, self._inbox, self._said = master, inbox, said
        self._topic, self._type, self._node = key
        self._ended = threading.Event()
        threading.Thread(target=self._run, name=f"ros1 {self._topic}", daemon=True).start()

    def close(self) -> None:
        """End it, at the latest when the thread looks next."""
        self._ended.set()

    def _run(self) -> None:
        retry = Retry(self._node, self._ended, self._said)
        while not self._ended.is_set():
            try:
                for data in self._messages():
                    retry.worked()
                    raw = RawMessage(self._topic, full_name(self._type), time.time_ns(), data)
                    self._inbox.offer(raw, is_ros1=True)
                retry.wait()  # an orderly end: the node leaves, and the master will know
            except _FAILURES as error:
                retry.failed(error)

    def _messages(self) -> Iterator[bytes]:
        """Messages until `close`; raises one of _FAILURES where the connection breaks off."""
        node = _ask(self._master, "lookupNode", self._node)
        protocol = _ask(str(node), "requestTopic", self._topic, [["TCPROS"]])
        if protocol[0] != "TCPROS":
            raise RecordingError(f"no TCPROS, but {str(protocol)[:80]}")
        with socket.create_connection((str(protocol[1]), int(protocol[2])), PATIENCE) as connected:
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            connected.settimeout(TICK)
            connected.sendall(_header(self._topic, self._type))
            fields = _fields(self._block(connected, LARGEST_HEADER) or b"")
            if "error" in fields:
                raise RecordingError(f"{self._topic}: refused: {fields['error']}")
            if fields.get("type") != self._type:
                was = f"{fields.get('type')}, not {self._type}"
                raise RecordingError(f"{self._topic} has messages of {was}")
            bound = largest(full_name(self._type))
            while (data := self._block(connected, bound)) is not None:
                yield data

    def _block(self, connected: socket.socket, bound: int) -> bytes | None:
        """What comes behind its length; None once ended, by either side."""
        length = self._exactly(connected, 4, may_end=True)
        if length is None:
            return None
        (size,) = struct.unpack("<I", length)
        if size > bound:
            raise RecordingError(
                f"{self._topic}: a message of {size} bytes; up to {bound} are taken"
            )
        return self._exactly(connected, size)

    def _exactly(
        self, connected: socket.socket, size: int, *, may_end: bool = False
    ) -> bytes | None:
        parts, missing = list[bytes](), size
        while missing:
            if self._ended.is_set():
                return None
            try:
                part = connected.recv(min(missing, 1 << 20))
            except TimeoutError:
                continue
            if not part and may_end and missing == size:
                return None
            if not part:
                raise ConnectionError("the publisher closed the connection")
            parts.append(part)
            missing -= len(part)
        return b"".join(parts)


def _header(topic: str, type_: str) -> bytes:
    """Header of a subscriber that takes any version of the message."""
    fields = {"callerid": CALLER, "topic": topic, "type": type_, "md5sum": "*", "tcp_nodelay": "1"}
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(struct.pack("<I", len(line)) + line for line in lines)
    return struct.pack("<I", len(body)) + body


def _fields(header: bytes) -> dict[str, str]:
    """Fields of a publisher's header; raises ValueError or struct.error where it is malformed."""
    fields, at = {}, 0
    while at < len(header):
        if at + 4 > len(header):
            raise ValueError("the publisher's header is malformed")
        (size,) = struct.unpack_from("<I", header, at)
        line = header[at + 4 : at + 4 + size]
        if len(line) < size:
            raise ValueError("the publisher's header is malformed")
        key, _, value = line.decode("utf-8", "replace").partition("=")
        fields[key] = value
        at += 4 + size
    return fields
