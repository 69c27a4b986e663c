"""What a node of ours publishes, as others hear it: whole, latched, restarted, and hostile."""

import http.client
import queue
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("rosbags")

from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.live import connection, ros1, ros1_publisher
from perception.sources.live.ros1 import TcprosConnection, ask
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.ros.message_types import message_types
from tests.perception.sources.live.ros1_master import FakeMaster, fake_master
from tests.waiting import until

TOPIC, TYPE = "/said", "std_msgs/msg/String"


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "MIN_PAUSE", 0.02)
    monkeypatch.setattr(connection, "MAX_PAUSE", 0.1)
    monkeypatch.setattr(ros1, "POLL", 0.02)
    monkeypatch.setattr(ros1, "TICK", 0.02)
    monkeypatch.setattr(ros1, "HEADER_WITHIN", 0.5)
    monkeypatch.setattr(ros1_publisher, "CHECK_INTERVAL", 0.02)


@pytest.fixture
def master() -> Iterator[FakeMaster]:
    with fake_master() as master:
        yield master


@contextmanager
def publisher(master: FakeMaster, *latched: str) -> Iterator[Ros1Publisher]:
    made = Ros1Publisher(master.address, {TOPIC: TYPE}, frozenset(latched))
    try:
        until(lambda: bool(master.publishers.get(TOPIC)))
        yield made
    finally:
        made.close()


def string(text: str) -> Any:
    return message_types(True).types[TYPE](data=text)


class Inbox:
    def __init__(self) -> None:
        self.heard = queue.Queue[str]()

    def wanted(self, topics: Any) -> set[str]:
        return {topic for topic, type_ in topics.items() if type_ == TYPE}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        self.heard.put(decoded(raw, is_ros1, "here").data)


@contextmanager
def listening(master: FakeMaster) -> Iterator[Inbox]:
    inbox, ended = Inbox(), threading.Event()
    thread = threading.Thread(target=master.address.run, args=(inbox, ended))
    thread.start()
    try:
        yield inbox
    finally:
        ended.set()
        thread.join()


def tcpros_address(master: FakeMaster) -> tuple[str, int]:
    (api,) = master.publishers[TOPIC].values()
    kind, host, port = ask(api, "requestTopic", TOPIC, [["TCPROS"]], caller="/test")
    assert kind == "TCPROS"
    return host, port


def answered(master: FakeMaster, **fields: str) -> dict[str, str]:
    with socket.create_connection(tcpros_address(master)) as connected:
        connection = TcprosConnection(connected, "test", threading.Event())
        connection.send_fields({"callerid": "/test", "topic": TOPIC, "md5sum": "*", **fields})
        return connection.fields()


def test_what_is_published_is_heard_and_latched_for_who_comes_later(master: FakeMaster) -> None:
    with publisher(master, TOPIC) as made:
        made.publish(TOPIC, string("before"))
        with listening(master) as inbox:
            assert inbox.heard.get(timeout=20) == "before"
            made.publish(TOPIC, string("grüße"))
            assert inbox.heard.get(timeout=20) == "grüße"
        until(lambda: made.subscribers(TOPIC) == 0)
        made.publish(TOPIC, string("nobody hears this"))
    assert not master.publishers[TOPIC]


def test_a_subscriber_that_stalls_misses_messages_and_holds_nobody_up(master: FakeMaster) -> None:
    large = string("x" * 1_000_000)
    with publisher(master) as made, socket.create_connection(tcpros_address(master)) as stalled:
        connection = TcprosConnection(stalled, "test", threading.Event())
        connection.send_fields({"callerid": "/test", "topic": TOPIC, "md5sum": "*"})
        connection.fields()  # and reads nothing more for now
        with listening(master) as inbox:
            until(lambda: made.subscribers(TOPIC) == 2)
            for _ in range(30):  # far more than the sockets buffer
                made.publish(TOPIC, large)
                assert inbox.heard.get(timeout=20) == large.data
        made.publish(TOPIC, string("the last"))
        heard = [connection.block(1 << 21)]
        while heard[-1] != b"\x08\x00\x00\x00the last":
            heard.append(connection.block(1 << 21))
        assert len(heard) < 31


def test_a_restarted_master_gets_to_know_the_node_again(master: FakeMaster) -> None:
    with publisher(master) as made:
        master.forget()
        until(lambda: bool(master.publishers.get(TOPIC)))
        with listening(master) as inbox:
            until(lambda: made.subscribers(TOPIC) == 1)
            made.publish(TOPIC, string("again"))
            assert inbox.heard.get(timeout=20) == "again"


def test_a_subscriber_of_another_topic_or_version_is_refused(master: FakeMaster) -> None:
    with publisher(master):
        assert "publishes no /other" in answered(master, topic="/other")["error"]
        assert "md5sum" in answered(master, md5sum="0123")["error"]
        told = answered(master, md5sum="992ce8a1687cec8c8bd883ec73ca41d1")
        assert (told["type"], told["message_definition"]) == ("std_msgs/String", "string data\n")
        (api,) = master.publishers[TOPIC].values()
        for topic, protocols in (("/other", [["TCPROS"]]), (TOPIC, [["UDPROS"]]), (TOPIC, [])):
            with pytest.raises(Exception, match="failed"):
                ask(api, "requestTopic", topic, protocols, caller="/test")


@pytest.mark.parametrize(
    "sent",
    [
        b"",
        b"\xff\xff\xff\xff" + b"x" * 1000,
        struct.pack("<I", 8) + struct.pack("<I", 1 << 31) + b"abcd",
        struct.pack("<I", 4) + b"\x00\x00\x00\x00",
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack("<I", 100) + b"cut",
    ],
)
def test_hostile_subscribers_are_left(master: FakeMaster, sent: bytes) -> None:
    with publisher(master, TOPIC) as made:
        made.publish(TOPIC, string("for the others"))
        with socket.create_connection(tcpros_address(master)) as hostile:
            hostile.sendall(sent)
            hostile.settimeout(20)
            try:
                while hostile.recv(1 << 16):
                    pass
            except ConnectionError:
                pass
        with listening(master) as inbox:
            assert inbox.heard.get(timeout=20) == "for the others"


def test_a_huge_request_is_not_read(master: FakeMaster) -> None:
    with publisher(master):
        (api,) = master.publishers[TOPIC].values()
        asked = http.client.HTTPConnection(api.removeprefix("http://").rstrip("/"), timeout=20)
        asked.putrequest("POST", "/RPC2")
        asked.putheader("Content-Length", str(1 << 40))
        asked.endheaders()
        assert asked.getresponse().status == 413
        asked.close()


@pytest.mark.parametrize("answer", [7, [], [0, "no", 0], [1, "", 3], [1, "", [[["/a", 5]], 0]]])
def test_a_master_that_lies_is_asked_again(answer: Any) -> None:
    with fake_master() as master:
        asked = []

        def hostile(caller: str) -> Any:
            asked.append(caller)
            return answer

        master.server.register_function(hostile, "getSystemState")
        made = Ros1Publisher(master.address, {TOPIC: TYPE})
        try:
            until(lambda: len(asked) >= 2)
            master.server.register_function(master.getSystemState, "getSystemState")
            until(lambda: bool(master.publishers.get(TOPIC)))
        finally:
            made.close()
