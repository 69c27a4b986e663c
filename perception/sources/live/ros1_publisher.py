"""Publisher of ROS 1 topics: a node that registers with the master and serves its subscribers.

The master tells subscribers the node's address (Master_API). They ask its XML-RPC API for a topic
(Slave_API) and connect by TCPROS. The number of connections, the size of requests and the time
that a subscriber may take are limited.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
import xmlrpc.server
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from socketserver import ThreadingMixIn
from typing import Any, Final

from perception.sources.live.connection import Retry
from perception.sources.live.ros1 import (
    CALLER,
    FAILURES,
    PATIENCE,
    Ros1Master,
    TcprosConnection,
    block,
)
from perception.sources.ros.message_types import message_types, serialised

CHECK_INTERVAL: Final = 1.0  # [s] between two checks that the master still knows the node
MAX_CONNECTIONS: Final = 64  # of subscribers, with or without a topic so far
WAITING: Final = 10  # messages that wait for a subscriber; then the oldest are dropped
MAX_REQUEST: Final = 1 << 20  # [bytes]


class Ros1Publisher:
    """A node that publishes `types` (topic -> type, e.g. sensor_msgs/msg/Image); close it.

    Later subscribers of a topic of `latched` get its last message first. The node registers with
    the master on its own thread, and again after the master was restarted. Other nodes reach it at
    ROS_HOSTNAME or ROS_IP, else at the address of the interface that leads to the master.
    """

    def __init__(
        self, master: Ros1Master, types: Mapping[str, str], latched: frozenset[str] = frozenset()
    ) -> None:
        self.name = f"{CALLER}_{os.getpid()}_{time.monotonic_ns()}"
        self._master = replace(master, caller=self.name)
        self._types, self._latched = dict(types), latched
        self._subscribers: dict[str, list[deque[bytes]]] = {topic: [] for topic in types}
        self._last: dict[str, bytes] = {}
        self._lock, self._ended = threading.Condition(), threading.Event()
        self._connections = set[threading.Thread]()
        self._free = threading.Semaphore(MAX_CONNECTIONS)
        self._host, bound = _own_host(master)
        self._listener = socket.create_server((bound, 0))
        self._server = _Api((bound, 0), _Request, logRequests=False, allow_none=True)
        for method in ("requestTopic", "publisherUpdate", "paramUpdate", "getPid", "shutdown"):
            self._server.register_function(getattr(self, f"_{method}"), method)
        self._uri = f"http://{self._host}:{self._server.server_address[1]}/"
        self._threads = [
            threading.Thread(target=run, name=f"ros1 {run.__name__}", daemon=True)
            for run in (self._serve, self._accept, self._register)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def master(self) -> Ros1Master:
        """The master, called in the name of this node."""
        return self._master

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter of the master; left out where the master is away."""
        with contextlib.suppress(*FAILURES):
            self._master.ask("setParam", name, value)

    def subscribers(self, topic: str) -> int:
        """Number of a topic's subscribers now."""
        with self._lock:
            return len(self._subscribers[topic])

    def publish(self, topic: str, message: Any) -> None:
        """Send a message of the topic's type; does not wait for subscribers, of whom slow ones miss
        messages.
        """
        data = block(serialised(self._types[topic], message, is_ros1=True))
        with self._lock:
            if topic in self._latched:
                self._last[topic] = data
            for waiting in self._subscribers[topic]:
                waiting.append(data)
            self._lock.notify_all()

    def close(self) -> None:
        """Unregister, and close all connections after the messages already sent."""
        if self._ended.is_set():
            return
        self._ended.set()
        for topic in self._types:
            with contextlib.suppress(*FAILURES):
                self._master.ask("unregisterPublisher", topic, self._uri)
        self._server.shutdown()
        self._server.server_close()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            self._lock.notify_all()
            connections = list(self._connections)
        until = time.monotonic() + PATIENCE
        for thread in (*self._threads, *connections):  # messages sent before still arrive
            thread.join(max(until - time.monotonic(), 0.0))

    def _serve(self) -> None:
        self._server.serve_forever(0.05)

    def _register(self) -> None:
        """Keep the node registered with the master, whenever that starts."""
        retry = Retry(self._master.address, self._ended)
        while not self._ended.is_set():
            try:
                if not self._is_registered():
                    for topic, type_ in self._types.items():
                        short = type_.replace("/msg/", "/")
                        self._master.ask("registerPublisher", topic, short, self._uri)
                retry.worked()
            except OSError:
                retry.wait()  # subscriptions to the same master warn that it is away
            except FAILURES as error:
                retry.failed(error)
            self._ended.wait(CHECK_INTERVAL)

    def _is_registered(self) -> bool:
        publishers, *_ = self._master.ask("getSystemState")
        known = {str(topic) for topic, nodes in publishers if self.name in nodes}
        return known >= self._types.keys()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                connected, _ = self._listener.accept()
            except OSError:
                return
            if not self._free.acquire(blocking=False):
                connected.close()
                continue
            thread = threading.Thread(
                target=self._answer_subscriber, args=(connected,), daemon=True
            )
            with self._lock:
                self._connections.add(thread)
            thread.start()

    def _answer_subscriber(self, connected: socket.socket) -> None:
        """Serve one connection: accept its subscription to a topic, and send until it ends."""
        try:
            connection = TcprosConnection(connected, self.name, self._ended)
            topic = self._accepted_topic(connection, connection.fields())
            if topic is not None:
                self._send_messages(topic, connected)
        except FAILURES:
            pass
        finally:
            connected.close()
            self._free.release()
            with self._lock:
                self._connections.discard(threading.current_thread())

    def _send_messages(self, topic: str, connected: socket.socket) -> None:
        """Send a topic's messages, however slowly they are taken, until either side ends."""
        waiting = deque[bytes](maxlen=WAITING)
        with self._lock:
            waiting.extend([self._last[topic]] if topic in self._last else [])
            self._subscribers[topic].append(waiting)
        connected.settimeout(None)
        try:
            while True:
                with self._lock:
                    if not waiting and not self._ended.is_set():
                        self._lock.wait(CHECK_INTERVAL)
                    data = waiting.popleft() if waiting else None
                if data is not None:
                    connected.sendall(data)
                elif self._ended.is_set() or _has_left(connected):
                    return
        finally:
            with self._lock:
                self._subscribers[topic] = [
                    one for one in self._subscribers[topic] if one is not waiting
                ]

    def _accepted_topic(self, connection: TcprosConnection, asked: Mapping[str, str]) -> str | None:
        """Answer a subscriber's header; returns its topic, None where the topic is refused."""
        topic = asked.get("topic", "")
        if topic not in self._types:
            connection.send_fields({"error": f"{self.name} publishes no {topic[:200]}"})
            return None
        type_ = self._types[topic]
        definition, md5sum = message_types(True).generate_msgdef(type_, ros_version=1)
        if asked.get("md5sum") not in ("*", md5sum):
            connection.send_fields({"error": f"{topic} has the md5sum {md5sum}"})
            return None
        connection.send_fields(
            {
                "callerid": self.name,
                "topic": topic,
                "type": type_.replace("/msg/", "/"),
                "md5sum": md5sum,
                "message_definition": definition,
                "latching": str(int(topic in self._latched)),
            }
        )
        return topic

    def _requestTopic(self, caller: str, topic: str, protocols: Any) -> list[Any]:  # noqa: N802
        if topic not in self._types:
            return [0, f"{self.name} publishes no such topic", 0]
        if not any(protocol[:1] == ["TCPROS"] for protocol in protocols):
            return [0, f"{self.name} speaks TCPROS alone", 0]
        return [1, "ready", ["TCPROS", self._host, self._listener.getsockname()[1]]]

    def _publisherUpdate(self, caller: str, topic: str, publishers: Any) -> list[Any]:  # noqa: N802
        return [1, "", 0]

    def _paramUpdate(self, caller: str, key: str, value: Any) -> list[Any]:  # noqa: N802
        return [1, "", 0]

    def _getPid(self, caller: str) -> list[Any]:  # noqa: N802
        return [1, "", os.getpid()]

    def _shutdown(self, caller: str, reason: str = "") -> list[Any]:
        return [0, "it ends when its program does", 0]


def _has_left(connected: socket.socket) -> bool:
    """Whether the other side closed the connection; what it sends is dropped."""
    readable, _, _ = select.select([connected], [], [], 0)
    return bool(readable) and not connected.recv(4096)


class _Request(xmlrpc.server.SimpleXMLRPCRequestHandler):
    """A request of limited size and duration."""

    protocol_version = "HTTP/1.1"
    timeout = PATIENCE

    def do_POST(self) -> None:  # noqa: N802 - named by http.server
        length = self.headers.get("content-length", "")
        if not length.isdecimal() or int(length) > MAX_REQUEST:
            self.close_connection = True
            self.send_error(413)
            return
        super().do_POST()


class _Api(ThreadingMixIn, xmlrpc.server.SimpleXMLRPCServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore errors of a request: the other node tries again."""


def _own_host(master: Ros1Master) -> tuple[str, str]:
    """Address to announce to other nodes, and address to listen at."""
    given = os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    if given:
        return given, ""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((master.host, master.port))  # sends nothing
            host = str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname(), ""
    return host, host
