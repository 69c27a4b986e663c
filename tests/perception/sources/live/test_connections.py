"""Real peers on real sockets: ROS 1 and Foxglove, whole, broken off, and hostile."""

import json
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("websockets")
from kg.model.errors import RecordingError
from perception.sources.bag_writer import COLOUR, DEPTH
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live import connection, ros1, stream
from perception.sources.live.foxglove import FoxgloveConnection
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.stream import FrameStream
from perception.sources.recording import FolderRecording
from tests.perception.sources.live.foxglove_peer import foxglove_peer
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.ros1_peer import header, ros1_peer
from tests.waiting import until

Messages = Callable[[str], list[RawMessage]]


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.1)
    monkeypatch.setattr(stream, "SILENT", 0.3)
    monkeypatch.setattr(connection, "MIN_PAUSE", 0.02)
    monkeypatch.setattr(connection, "MAX_PAUSE", 0.1)
    monkeypatch.setattr(ros1, "POLL", 0.02)
    monkeypatch.setattr(ros1, "TICK", 0.02)


def types_of(raws: list[RawMessage], *, ros1: bool) -> dict[str, str]:
    kinds = {raw.topic: raw.type for raw in raws}
    return {t: k.replace("/msg/", "/") if ros1 else k for t, k in kinds.items()}


@contextmanager
def running(peer: Any) -> Iterator[FrameStream]:
    made, ended = FrameStream(peer.address), threading.Event()
    thread = threading.Thread(target=peer.run, args=(made, ended), daemon=True)
    thread.start()
    try:
        yield made
    finally:
        ended.set()
        thread.join(10)
        assert not thread.is_alive()


def published(peer: Any, raws: list[RawMessage]) -> None:
    for raw in raws:
        peer.publish(raw)


def frame_of(made: FrameStream) -> np.ndarray:
    frame = made.next_frame(20)
    assert frame is not None, made.problem
    return frame.rgb


def test_ros1_topics_become_frames(room: FolderRecording, messages: Messages) -> None:
    raws = messages(".bag")
    with ros1_peer(types_of(raws, ros1=True)) as peer, running(peer.address) as made:
        for raw in raws:
            if raw.topic == "/tf_static":
                peer.publish(raw, latched=True)
        peer.wait_for([COLOUR, DEPTH, "/tf"])
        published(peer, raws)
        assert np.array_equal(frame_of(made), room.frame(5).rgb)
    assert {fields["md5sum"] for fields in peer.heard} == {"*"}


def test_a_ros1_node_that_hangs_up_is_connected_to_again(messages: Messages) -> None:
    raws = messages(".bag")
    with ros1_peer(types_of(raws, ros1=True)) as peer, running(peer.address) as made:
        peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
        published(peer, raws)
        frame_of(made)
        peer.hang_up()
        peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
        published(peer, raws)
        frame_of(made)


WRONG = header({"type": "std_msgs/String", "md5sum": "x"})
RIGHT = header({"type": "sensor_msgs/CompressedImage", "md5sum": "x"})


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (b"", "closed"),
        (b"\x10\x00", "closed"),
        (struct.pack("<I", 1 << 31) + b"x" * 100, "2147483648 bytes"),
        (struct.pack("<I", 9) + struct.pack("<I", 999) + b"hello", "malformed"),
        (struct.pack("<I", 2) + b"ab", "malformed"),
        (header({"error": "md5sums do not match"}), "refused: md5sums do not match"),
        (WRONG, "std_msgs/String"),
        (RIGHT + struct.pack("<I", (1 << 32) - 1), "4294967295 bytes"),
        (RIGHT + struct.pack("<I", 1000) + b"cut", "closed"),
    ],
)
def test_a_hostile_ros1_node_is_left_and_tried_again(messages, caplog, spoilt, said):
    raws = messages(".bag")
    with ros1_peer(types_of(raws, ros1=True)) as peer:
        peer.spoil = lambda topic: spoilt if topic == COLOUR else None
        with running(peer.address) as made:
            until(lambda: sum(fields["topic"] == COLOUR for fields in peer.heard) >= 3)
            peer.spoil = lambda topic: None
            peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
            published(peer, raws)
            frame_of(made)
    if spoilt:  # what closes before it begins is a node that leaves
        assert said in caplog.text


@pytest.mark.parametrize(
    "answer", [7, [], [0, "no", 0], [1, "", 3], [1, "", [[1]]], [1, "", [["/a", "b", "c"]]], "text"]
)
def test_a_hostile_ros1_master_is_asked_again(messages: Messages, answer: Any) -> None:
    raws = messages(".bag")
    with ros1_peer(types_of(raws, ros1=True)) as peer:
        asked = []

        def hostile(caller: str) -> Any:
            asked.append(caller)
            return answer

        master = peer.master.server
        master.register_function(hostile, "getTopicTypes")
        with running(peer.address) as made:
            until(lambda: len(asked) >= 2)
            master.register_function(peer.master.getTopicTypes, "getTopicTypes")
            peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
            published(peer, raws)
            frame_of(made)


def test_addresses_that_are_none_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for address in ("ros1://", "ros1://:11311", "ros1://host:port"):
        with pytest.raises(RecordingError, match="ros1://localhost:11311"):
            Ros1Master.at(address)
    monkeypatch.delenv("ROS_MASTER_URI", raising=False)
    assert Ros1Master.at("ros1").address == "ros1://localhost:11311"
    monkeypatch.setenv("ROS_MASTER_URI", "http://robot:11312/")
    assert Ros1Master.at("ros1").address == "ros1://robot:11312"
    assert Ros1Master.at("ros1://robot").port == 11311
    for address in ("ws://", "ws://:8765", "ws://host:port"):
        with pytest.raises(RecordingError, match="ws://localhost:8765"):
            FoxgloveConnection.at(address)


@pytest.mark.parametrize(("suffix", "encoding"), [(".bag", "ros1"), (".mcap", "cdr")])
def test_foxglove_channels_become_frames(room, messages, suffix, encoding):
    raws = messages(suffix)
    types = types_of(raws, ros1=encoding == "ros1")
    with foxglove_peer(types, encoding) as peer, running(FoxgloveConnection(peer.address)) as made:
        peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
        published(peer, raws)
        assert np.array_equal(frame_of(made), room.frame(5).rgb)
        peer.hang_up()
        peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
        published(peer, [replace(raw, time=(1 << 64) - 1, data=b"\xff" * 99) for raw in raws])
        published(peer, raws)
        frame_of(made)


@pytest.mark.parametrize(
    "greeting",
    [
        "no JSON",
        "[" * 100_000,
        "[]",
        json.dumps({"op": "advertise"}),
        json.dumps({"op": "advertise", "channels": [{"id": "x", "encoding": "cdr"}]}),
        json.dumps({"op": "unadvertise", "channelIds": [[1]]}),
        json.dumps({"op": "unheard of"}),
        b"",
        b"\x01\x02",
        b"\x01" + b"\xff" * 50,
        b"\x09" + b"\x00" * 500,
    ],
)
def test_a_hostile_foxglove_server_is_left_or_ignored(messages, greeting):
    raws = messages(".mcap")
    with foxglove_peer(types_of(raws, ros1=False), "cdr") as peer:
        peer.greeting = [greeting]
        with running(FoxgloveConnection(peer.address)) as made:
            until(lambda: peer.connections)
            peer.greeting = []
            peer.wait_for([COLOUR, DEPTH, "/tf", "/tf_static"])
            published(peer, raws)
            frame_of(made)


def test_what_is_no_foxglove_server_is_tried_again(messages, caplog):
    with fake_master() as other:
        address = f"ws://127.0.0.1:{other.address.port}"
        with running(FoxgloveConnection(address)):
            until(lambda: "trying again" in caplog.text)
