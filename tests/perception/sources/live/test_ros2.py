"""ROS 2 topics of Cyclone DDS peers, on the loopback interface."""

import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from kg.model.errors import RecordingError
from perception.sources.bag_writer import COLOUR, DEPTH, write_bag
from perception.sources.bags.bag_file import RawMessage, decoded
from perception.sources.listing import Streams
from perception.sources.live import ros2, stream
from perception.sources.live.ros2 import Ros2Domain, network_settings, topics_of
from perception.sources.live.stream import FrameStream
from perception.sources.recording import FolderRecording
from perception.sources.recording_options import RecordingOptions
from tests.perception.sources.live import ros2_peer
from tests.waiting import until

LOOPBACK = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>20</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""
#: the first of eight domains that no other process of a run of tests uses; without processes
#: beside this one, those of another run are likely to be others
_WORKER = os.environ.get("PYTEST_XDIST_WORKER")
DOMAIN = 100 + 8 * (int(_WORKER.removeprefix("gw")) % 8 if _WORKER else 8 + os.getpid() % 8)


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr(stream, "SETTLING", 0.1)


@pytest.fixture
def bag(room: FolderRecording, tmp_path: Path) -> Path:
    for _ in write_bag(room, tmp_path / "room.mcap"):
        pass
    return tmp_path / "room.mcap"


@contextmanager
def peer(bag: Path) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, ros2_peer.__file__, str(DOMAIN), str(bag)]
    with subprocess.Popen(command) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def running(streams: Streams | None = None) -> Iterator[FrameStream]:
    domain, ended = Ros2Domain(DOMAIN), threading.Event()
    made = FrameStream(domain.address, RecordingOptions(streams=streams or Streams()))
    thread = threading.Thread(target=domain.run, args=(made, ended), daemon=True)
    thread.start()
    try:
        yield made
    finally:
        ended.set()
        thread.join(10)
        assert not thread.is_alive()


def frame_of(made: FrameStream) -> np.ndarray:
    frame = made.next_frame(120)
    assert frame is not None, made.problem
    return frame.rgb


def test_topics_become_frames_also_after_the_node_was_killed(room, bag):
    frames = [frame.rgb for frame in room.frames()]

    def is_of_room(rgb: np.ndarray) -> bool:
        return any(np.array_equal(rgb, frame) for frame in frames)

    with running() as made:
        with peer(bag):
            assert is_of_room(frame_of(made))
        while made.next_frame(1) is not None:
            pass
        with peer(bag):
            assert is_of_room(frame_of(made))
    assert made.counts.unreadable == 0


def test_hostile_messages_are_skipped(bag: Path, caplog: pytest.LogCaptureFixture) -> None:
    participant = DomainParticipant(DOMAIN)
    header = ros2_peer.Header(ros2_peer.Time(-5, 2**32 - 1), "x" * 1000)
    turned = ros2_peer.Quaternion(0.0, 0.0, 0.0, float("nan"))
    moved = ros2_peer.Transform(ros2_peer.Vector3(1e308, 0.0, 0.0), turned)
    camera = ros2_peer.CameraInfo(
        header, 2**32 - 1, 0, "plumb_bob", [float("nan")] * 5, [1e308] * 9, [0.0] * 9, [0.0] * 12,
        0, 0, ros2_peer.RegionOfInterest(0, 0, 0, 0, False),
    )  # fmt: skip
    hostile = {
        "/other/colour": ros2_peer.Image(header, 2**32 - 1, 2**32 - 1, "rgb8", 0, 1, b"abc"),
        "/other/depth": ros2_peer.Image(header, 10, 10, "\n16UC1", 1, 0, b""),
        "/other/camera_info": camera,
        "/tf": ros2_peer.TFMessage([ros2_peer.TransformStamped(header, "camera", moved)]),
    }
    writers = [
        (DataWriter(participant, Topic(participant, f"rt{topic}", type(message))), message)
        for topic, message in hostile.items()
    ]
    ended = threading.Event()

    def write() -> None:
        while not ended.wait(0.05):
            for writer, message in writers:
                writer.write(message)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        with running(Streams(COLOUR, DEPTH)) as made, peer(bag):
            frame_of(made)
    finally:
        ended.set()
        thread.join()
    assert "messages of /tf are skipped" in caplog.text


class Inbox:
    def __init__(self, *topics: str) -> None:
        self.topics = set(topics)
        self.heard = SimpleQueue[RawMessage]()

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        return self.topics & set(topics)

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        assert not is_ros1
        self.heard.put(raw)


@contextmanager
def reading(*topics: str) -> Iterator[Inbox]:
    inbox, ended = Inbox(*topics), threading.Event()
    thread = threading.Thread(target=Ros2Domain(DOMAIN).run, args=(inbox, ended))
    thread.start()
    try:
        yield inbox
    finally:
        ended.set()
        thread.join()


def test_odometry_comes_as_it_was_written() -> None:
    header = ros2_peer.Header(ros2_peer.Time(1_700_000_000, 123), "odom")
    turned = ros2_peer.Quaternion(0.0, 0.0, 0.6, 0.8)
    pose = ros2_peer.Pose(ros2_peer.Point(1.5, -2.5, 0.0), turned)
    still = ros2_peer.Twist(ros2_peer.Vector3(0.0, 0.0, 0.0), ros2_peer.Vector3(0.0, 0.0, 0.25))
    message = ros2_peer.Odometry(
        header,
        "base_link",
        ros2_peer.PoseWithCovariance(pose, [0.5] * 36),
        ros2_peer.TwistWithCovariance(still, [0.0] * 36),
    )
    participant = DomainParticipant(DOMAIN)
    made = Topic(participant, "rt/odom", ros2_peer.Odometry)
    writer = DataWriter(participant, made, qos=Qos(RELIABLE))
    with reading("/odom") as inbox:
        raw = None
        while raw is None:
            writer.write(message)
            with suppress(Empty):
                raw = inbox.heard.get(timeout=0.1)
    assert (raw.topic, raw.type) == ("/odom", "nav_msgs/msg/Odometry")
    odometry = decoded(raw, False, "here")
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (1_700_000_000, 123)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    position, orientation = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (position.x, position.y, orientation.z, orientation.w) == (1.5, -2.5, 0.6, 0.8)
    assert odometry.pose.covariance.tolist() == [0.5] * 36
    assert odometry.twist.twist.angular.z == 0.25


RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
BEST_EFFORT = Policy.Reliability.BestEffort
KEPT, NOT_KEPT = Policy.Durability.TransientLocal, Policy.Durability.Volatile


class Matched(Listener):
    def __init__(self) -> None:
        super().__init__()
        self.event = threading.Event()

    def on_publication_matched(self, writer: DataWriter, status: object) -> None:
        self.event.set()


@pytest.mark.parametrize(
    ("type_", "offered", "requested"),
    [
        (ros2_peer.TFMessage, (RELIABLE, KEPT), (RELIABLE, KEPT)),
        (ros2_peer.TFMessage, (RELIABLE, NOT_KEPT), (RELIABLE, NOT_KEPT)),
        (ros2_peer.TFMessage, (BEST_EFFORT, NOT_KEPT), (BEST_EFFORT, NOT_KEPT)),
        (ros2_peer.Image, (RELIABLE, KEPT), (BEST_EFFORT, NOT_KEPT)),
    ],
)
def test_a_reader_requests_the_quality_that_its_writer_offers(type_, offered, requested):
    participant = DomainParticipant(DOMAIN)
    matched, name = Matched(), f"/quality_{uuid.uuid4().hex}"
    made = Topic(participant, f"rt{name}", type_)
    writer = DataWriter(participant, made, qos=Qos(*offered), listener=matched)
    with reading(name):
        assert matched.event.wait(30)
        (reader,) = writer.get_matched_subscriptions()
        subscription = writer.get_matched_subscription_data(reader)
    assert subscription is not None
    reliability, durability = requested
    assert type(subscription.qos[Policy.Reliability]) is type(reliability)
    assert subscription.qos[Policy.Durability] == durability


def test_a_reader_that_comes_late_gets_the_last_message_of_a_topic_that_is_kept() -> None:
    participant = DomainParticipant(DOMAIN)
    made = Topic(participant, "rt/tf_late", ros2_peer.TFMessage)
    writer = DataWriter(participant, made, qos=Qos(RELIABLE, KEPT, Policy.History.KeepLast(1)))
    writer.write(ros2_peer.TFMessage([]))
    with reading("/tf_late") as inbox:
        assert inbox.heard.get(timeout=30).topic == "/tf_late"


def written(topic: str, type_: str, *policies: object) -> SimpleNamespace:
    return SimpleNamespace(topic_name=topic, type_name=type_, qos=Qos(*policies))


def test_a_topic_is_read_as_all_that_write_it_allow() -> None:
    tf, image = "tf2_msgs::msg::dds_::TFMessage_", "sensor_msgs::msg::dds_::Image_"
    reliable, best = Policy.Reliability.Reliable(1), Policy.Reliability.BestEffort
    kept = Policy.Durability.TransientLocal
    found = {
        topic.name: (topic.type, topic.reliable, topic.durable)
        for topic in topics_of(
            [
                written("rt/tf", tf, reliable),
                written("rt/tf_static", tf, reliable, kept),
                written("rt/mixed", tf, reliable, kept),
                written("rt/mixed", tf, best),
                written("rt/image", image, reliable, kept),
                written("rt/two", tf, reliable),
                written("rt/two", image, reliable),
                written("rt/unknown", "my_msgs::msg::dds_::Mine_", reliable),
                written("rq/serviceRequest", tf, reliable),
                written("ros_discovery_info", tf, reliable),
            ]
        )
    }
    assert found == {
        "/tf": ("tf2_msgs/msg/TFMessage", True, False),
        "/tf_static": ("tf2_msgs/msg/TFMessage", True, True),
        "/mixed": ("tf2_msgs/msg/TFMessage", False, False),
        "/image": ("sensor_msgs/msg/Image", False, False),
        "/two": ("tf2_msgs/msg/TFMessage", True, False),
    }


@pytest.mark.parametrize(
    "variable", [("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]
)
def test_the_variables_of_ros_configure_the_network(bag, monkeypatch, variable):
    assert network_settings({}) == network_settings({"ROS_LOCALHOST_ONLY": "0"}) == ""
    with peer(bag):  # in a process of its own, on the loopback interface alone
        monkeypatch.setenv("CYCLONEDDS_URI", "")
        monkeypatch.setenv(*variable)
        with running() as made:
            frame_of(made)


def test_a_domain_without_a_topic_is_told_with_what_may_help(monkeypatch, caplog):
    monkeypatch.setattr(ros2, "ALONE", 0.1)
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:11811")
    with reading("/nothing"):
        until(lambda: "no topic of ROS 2" in caplog.text)
    (line,) = (r.getMessage() for r in caplog.records if "no topic" in r.getMessage())
    for word in (f"domain {DOMAIN}", "CYCLONEDDS_URI", "ROS_DOMAIN_ID", "foxglove_bridge"):
        assert word in line
    assert "robots with a discovery server (ROS_DISCOVERY_SERVER), Zenoh" in line


def test_static_peers_are_asked_beside_all_that_multicast_reaches() -> None:
    made = network_settings(
        {"ROS_STATIC_PEERS": "192.0.2.7;robot.local;", "ROS_LOCALHOST_ONLY": "0"}
    )
    settings = ElementTree.fromstring(made)
    peers = [peer.get("address") for peer in settings.iter("Peer")]
    assert peers == ["192.0.2.7", "robot.local"]
    assert settings.find(".//AllowMulticast") is None and settings.find(".//Interfaces") is None


def test_where_discovery_is_off_that_is_told() -> None:
    with pytest.raises(RecordingError, match="OFF finds no robot; SUBNET or LOCALHOST would work"):
        network_settings({"ROS_AUTOMATIC_DISCOVERY_RANGE": "off"})


def test_domains_are_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Ros2Domain.at("ros2").number == 0
    assert Ros2Domain.at("ros2://7").number == 7
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert Ros2Domain.at("ros2").address == "ros2://42"
    for address in ("ros2://robot", "ros2://233", "ros2://-1", "ros2://1:7400"):
        with pytest.raises(RecordingError, match="ros2://0 is one"):
            Ros2Domain.at(address)


def test_without_its_network_interface_it_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK.replace('"lo"', '"nowhere0"'))
    domain = Ros2Domain(DOMAIN + 1)
    with pytest.raises(RecordingError, match="CYCLONEDDS_URI"):
        domain.run(FrameStream(domain.address), threading.Event())
