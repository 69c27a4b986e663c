"""Searches behind a ROS 1 master: a house's camera, real detections, and navigation that fails."""

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("onnx")
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, RobotError
from kg.serving.opening import in_memory_map
from lab.robot.ros1_node import Ros1HouseNode
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live import connection, ros1, stream
from planner.execution.options import Event, SearchOptions
from planner.execution.protocol import (
    Arrived,
    Command,
    DetectionsMessage,
    Failed,
    GoTo,
    Hello,
    LookAround,
    RobotPose,
)
from planner.execution.search_loop import search
from planner.execution.transports import navigation
from planner.execution.transports.navigation import GoalPose, MoveBase
from planner.execution.transports.ros_robot import RosRobot
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import furnished_house
from planner.simulation.house_robot import TimedPose
from tests.perception.sources.live.ros1_master import FakeMaster, fake_master
from tests.planner.ros1_house import ORANGE, START, add_dining_room, house, robot, running
from tests.waiting import until

M = TypeVar("M")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.1)
    monkeypatch.setattr(stream, "SILENT", 0.2)
    monkeypatch.setattr(connection, "MIN_PAUSE", 0.02)
    monkeypatch.setattr(ros1, "POLL", 0.05)
    monkeypatch.setattr(ros1, "TICK", 0.05)


@pytest.fixture
def master() -> Iterator[FakeMaster]:
    with fake_master() as master:
        yield master


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        add_dining_room(semantic_map)
        yield semantic_map


class NoWay(Ros1HouseNode):
    def _way(self, goal: np.ndarray, heading: float) -> Sequence[TimedPose]:
        raise LayoutError("the door\nis closed")


class Elsewhere(Ros1HouseNode):
    def _begin(self, message: Any) -> None:
        message.goal.target_pose.header.frame_id = "/odom"
        super()._begin(message)


class Deaf(Ros1HouseNode):
    def _take_orders(self) -> None:
        self._orders.clear()


class Blind(Ros1HouseNode):
    def _publish_picture(self) -> None:
        pass


def test_a_thing_is_found_by_driving_through_a_house(master, semantic_map, tmp_path):
    with running(Ros1HouseNode(master.address, house(), START, rate=5)):
        outcome = search(semantic_map, ["orange"], robot(master.address, tmp_path))
    assert outcome.state == "found"
    (orange,) = semantic_map.objects("orange")
    assert outcome.found == (orange.iri,)
    assert np.linalg.norm(orange.p_map - ORANGE) < 0.1


@pytest.mark.parametrize(
    ("node", "said"),
    [
        (NoWay, "did not work: navigation aborted: the door is closed"),
        (Elsewhere, "did not work: navigation rejected the goal: goals are in the frame map"),
        (Deaf, "did not work: /move_base has not named its goal for 0.5 s"),
    ],
)
def test_why_a_goal_failed_is_said(master, semantic_map, tmp_path, monkeypatch, node, said):
    monkeypatch.setattr(navigation, "ANSWER", 0.5)
    events: list[Event] = []
    options = SearchOptions(
        on_event=events.append, stopping=lambda: any(event.kind == "surprise" for event in events)
    )
    with running(node(master.address, furnished_house(), START)):
        outcome = search(semantic_map, ["orange"], robot(master.address, tmp_path), options)
    assert outcome.state == "stopped"
    (surprise,) = [event.text for event in events if event.kind == "surprise"]
    assert surprise == said


def test_a_server_that_dies_ends_the_search_and_no_viewpoint_counts_as_unreachable(
    master: FakeMaster, semantic_map: SemanticMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(navigation, "GONE", 2.0)
    with running(Ros1HouseNode(master.address, furnished_house(), START, rate=0.2)) as node:

        def kill() -> bool:
            if node._active is not None:
                node._publisher.close()
            return False

        with pytest.raises(RobotError, match="/move_base is gone, with a goal under way"):
            search(
                semantic_map,
                ["orange"],
                robot(master.address, tmp_path),
                SearchOptions(stopping=kill),
            )
    (record,) = semantic_map.searches.all()
    assert record.state == "stopped"
    assert not semantic_map.searches.obstacles(record.iri)


def test_the_goal_under_way_is_cancelled_at_the_end(master, semantic_map, tmp_path):
    with running(Ros1HouseNode(master.address, furnished_house(), START, rate=0.2)) as node:
        options = SearchOptions(stopping=lambda: node._active is not None)
        outcome = search(semantic_map, ["orange"], robot(master.address, tmp_path), options)
        assert outcome.state == "stopped"
        until(lambda: node._goals and node._active is None)
        assert [goal.text for goal in node._goals] == ["cancelled"]


def test_what_is_missing_is_said_before_the_search_begins(master, semantic_map, tmp_path):
    def fails(**settings: Any) -> str:
        with pytest.raises(RobotError) as error:
            search(semantic_map, ["orange"], robot(master.address, tmp_path, **settings))
        assert semantic_map.searches.all() == ()
        return str(error.value)

    assert "nobody takes goals of /move_base/goal (--navigation)" in fails(patience=0.5)
    with running(Blind(master.address, house(), START)):
        assert "no colour images" in fails(patience=5)
    with running(Ros1HouseNode(master.address, house(), START)):
        assert "tf has no frame base (--base-frame)" in fails(base="base")


class SideCamera(CameraModel):
    """A camera that looks to the left of the robot."""

    def pose(self, x: float, y: float, heading: float) -> np.ndarray:
        return super().pose(x, y, heading + np.pi / 2)


def test_a_camera_that_looks_aside_is_turned_towards_what_is_to_be_seen(master, tmp_path):
    node = Ros1HouseNode(master.address, furnished_house(), START, rate=5)
    node._camera = SimulatedCamera(furnished_house(), SideCamera())
    driven = robot(master.address, tmp_path)
    try:
        with running(node):
            assert received(driven, Hello(), RobotPose).heading == pytest.approx(np.pi / 2)
            received(driven, GoTo(1, *START, -2.0), Arrived)
            assert received(driven, LookAround(2, 1.5, 2.5), DetectionsMessage).id == 2
            off = math.remainder(node.pose.heading - (-0.5 - np.pi / 2), 2 * np.pi)
            assert abs(off) < 0.05
    finally:
        driven.close()


def received(driven: RosRobot, command: Command, kind: type[M]) -> M:
    """The first answer of a kind, but pictures on the way."""
    driven.send(command)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        message = driven.receive(0.1)
        assert not isinstance(message, Failed), message
        if isinstance(message, kind) and getattr(message, "id", 0) is not None:
            return message
    raise AssertionError(f"no {kind.__name__}")


def test_malformed_status_is_said_once_and_skipped(master, caplog):
    client = MoveBase(master.address)
    try:
        client.send(GoalPose(1.0, 2.0, 0.5, "map", 0))
        for data in (b"", b"\xff" * 40, b"\x00" * 12 + b"\xff" * 4):
            for kind in ("actionlib_msgs/msg/GoalStatusArray", "std_msgs/msg/String"):
                client.offer(RawMessage("/move_base/status", kind, 0, data), is_ros1=True)
        assert client.outcome() is None
        assert caplog.text.count("are skipped") == 1
    finally:
        client.close()
