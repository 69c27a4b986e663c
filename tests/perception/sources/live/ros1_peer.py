"""A ROS 1 master and a node that publishes, as the wire protocols have them; no ROS needed."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

from perception.sources.bags.bag_file import RawMessage


def block(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def header(fields: Mapping[str, str]) -> bytes:
    return block(b"".join(block(f"{k}={v}".encode()) for k, v in fields.items()))


def fields_of(data: bytes) -> dict[str, str]:
    fields, at = {}, 0
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        key, _, value = data[at + 4 : at + 4 + size].decode().partition("=")
        fields[key] = value
        at += 4 + size
    return fields


class Ros1Peer:
    """Publishes topics once there is somebody to hear each; `spoil` alters what goes out."""

    def __init__(self, types: Mapping[str, str]) -> None:
        self.types = dict(types)
        self.spoil: Callable[[str], bytes | None] = lambda topic: None
        self.heard: list[dict[str, str]] = []  # headers of subscribers
        self._out: dict[str, list[socket.socket]] = {topic: [] for topic in types}
        self._latched: dict[str, bytes] = {}
        self._lock = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.master = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        for name in ("getTopicTypes", "getSystemState", "lookupNode", "requestTopic"):
            self.master.register_function(getattr(self, f"_{name}"), name)
        self._threads = [
            threading.Thread(target=self.master.serve_forever, args=(0.02,), daemon=True),
            threading.Thread(target=self._accept, daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> str:
        return f"ros1://127.0.0.1:{self.master.server_address[1]}"

    def close(self) -> None:
        self.master.shutdown()
        self.master.server_close()
        with suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.hang_up()
        for thread in self._threads:
            thread.join()

    def hang_up(self) -> None:
        """Close all connections."""
        with self._lock:
            for connections in self._out.values():
                for one in connections:
                    with suppress(OSError):
                        one.shutdown(socket.SHUT_RDWR)
                    one.close()
                connections.clear()

    def wait_for(self, topics: Sequence[str], seconds: float = 20) -> None:
        until = time.monotonic() + seconds
        while not all(self._out[topic] for topic in topics):
            assert time.monotonic() < until, f"nobody subscribed to {topics}"
            time.sleep(0.01)

    def publish(self, raw: RawMessage, *, latched: bool = False) -> None:
        with self._lock:
            if latched:
                self._latched[raw.topic] = raw.data
            for one in list(self._out.get(raw.topic, ())):
                try:
                    one.sendall(block(raw.data))
                except OSError:
                    self._out[raw.topic].remove(one)
                    one.close()

    def _getTopicTypes(self, caller: str) -> list[Any]:  # noqa: N802 - the protocol's name
        return [1, "", [[topic, type_] for topic, type_ in self.types.items()]]

    def _getSystemState(self, caller: str) -> list[Any]:  # noqa: N802
        return [1, "", [[[topic, ["/camera"]] for topic in self.types], [], []]]

    def _lookupNode(self, caller: str, node: str) -> list[Any]:  # noqa: N802
        return [1, "", f"http://127.0.0.1:{self.master.server_address[1]}/"]

    def _requestTopic(self, caller: str, topic: str, protocols: Any) -> list[Any]:  # noqa: N802
        assert protocols == [["TCPROS"]]
        return [1, "", ["TCPROS", "127.0.0.1", self.listener.getsockname()[1]]]

    def _accept(self) -> None:
        while True:
            try:
                connected, _ = self.listener.accept()
            except OSError:
                return
            (size,) = struct.unpack("<I", connected.recv(4, socket.MSG_WAITALL))
            fields = fields_of(connected.recv(size, socket.MSG_WAITALL))
            self.heard.append(fields)
            topic = fields["topic"]
            spoilt = self.spoil(topic)
            with self._lock:
                if spoilt is not None:
                    connected.sendall(spoilt)
                    connected.close()
                    continue
                connected.sendall(
                    header({"type": self.types[topic], "md5sum": "any", "callerid": "/camera"})
                )
                if topic in self._latched:
                    connected.sendall(block(self._latched[topic]))
                self._out[topic].append(connected)


@contextmanager
def ros1_peer(types: Mapping[str, str]) -> Iterator[Ros1Peer]:
    peer = Ros1Peer(types)
    try:
        yield peer
    finally:
        peer.close()
