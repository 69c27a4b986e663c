"""A node of ROS 1 that publishes, as the wire protocol has it, beside its master."""

import socket
import struct
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from perception.sources.bags.bag_file import RawMessage
from perception.sources.live.ros1 import Ros1Master
from tests.perception.sources.live.ros1_master import FakeMaster
from tests.waiting import until


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
        self.spoil: Callable[[str], bytes | None] = lambda topic: None
        self.heard: list[dict[str, str]] = []  # headers of subscribers
        self._out: dict[str, list[socket.socket]] = {topic: [] for topic in types}
        self._latched: dict[str, bytes] = {}
        self._lock = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.master = FakeMaster()
        self.master.types = dict(types)
        api = f"http://127.0.0.1:{self.address.port}/"
        self.master.publishers = {topic: {"/camera": api} for topic in types}
        self.master.server.register_function(self._request_topic, "requestTopic")
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    @property
    def address(self) -> Ros1Master:
        return self.master.address

    def close(self) -> None:
        self.master.close()
        with suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.hang_up()
        self._thread.join()

    def hang_up(self) -> None:
        """Close all connections."""
        with self._lock:
            for connections in self._out.values():
                for one in connections:
                    with suppress(OSError):
                        one.shutdown(socket.SHUT_RDWR)
                    one.close()
                connections.clear()

    def wait_for(self, topics: Sequence[str]) -> None:
        until(lambda: all(self._out[topic] for topic in topics))

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

    def _request_topic(self, caller: str, topic: str, protocols: Any) -> list[Any]:
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
                type_ = self.master.types[topic]
                connected.sendall(header({"type": type_, "md5sum": "any", "callerid": "/camera"}))
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
