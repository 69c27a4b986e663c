"""Ends of searches with a stand-in for Nav2: over DDS by topics, by a bridge's services.

That a thing is found is in tests/hereabouts/cli/test_whole_robot.py.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import onnx
import pytest

pytest.importorskip("cyclonedds")
from benchmarks.search.orange_network import orange_network
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, RobotError
from kg.serving.opening import in_memory_map
from perception.inference.detector import load_detector
from perception.sources.live import stream
from perception.sources.live.foxglove import FoxgloveConnection
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.stream import FrameStream
from planner.execution.options import Event, SearchOptions
from planner.execution.search_loop import search
from planner.execution.transports import navigation
from planner.execution.transports.navigation import Nav2Services, Nav2Topics, Navigation
from planner.execution.transports.ros_robot import RosRobot
from planner.simulation.house import furnished_house
from planner.simulation.house_robot import TimedPose
from tests.perception.sources.live import fast_dds
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK
from tests.planner.nav2_house import BridgedHouseNode, FastHouseNode, Nav2HouseNode
from tests.planner.ros1_house import START, add_dining_room, house, running
from tests.waiting import until

NODES = {"dds": Nav2HouseNode, "fast dds": FastHouseNode, "bridge": BridgedHouseNode}
FAST = pytest.param(
    "fast dds", marks=pytest.mark.skipif(not fast_dds.is_there(), reason=fast_dds.REASON)
)
WIRES = ["dds", FAST, "bridge"]


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    if "fast dds" not in request.node.name:  # its peer is found by multicast
        monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr(stream, "SETTLING", 0.1)
    monkeypatch.setattr(stream, "SILENT", 0.2)


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        add_dining_room(semantic_map)
        yield semantic_map


def domain(wire: str) -> Ros2Domain:
    """A domain for each wire: a process keeps its settings of a domain for a while."""
    return Ros2Domain(DOMAIN + 2 + 2 * (wire == "fast dds"))


def node(wire: str, kind: str = "") -> Nav2HouseNode:
    base = NODES[wire]
    if kind == "no way":

        class NoWay(base):  # type: ignore[misc,valid-type]
            def _way(self, goal: np.ndarray, heading: float) -> Sequence[TimedPose]:
                raise LayoutError("the door is closed")

        base = NoWay
    place = furnished_house() if kind else house()  # with nothing to be found, or an orange
    return base(domain(wire), place, START, rate=0.2 if kind else 5)


def robot(made: Nav2HouseNode, folder: Path) -> RosRobot:
    onnx.save(orange_network(), folder / "oranges.onnx")
    connection: FoxgloveConnection | Ros2Domain
    client: Navigation
    if isinstance(made, BridgedHouseNode):
        connection = FoxgloveConnection.at(made.url)
        client = Nav2Services(connection)
    else:
        connection = domain("fast dds" if isinstance(made, FastHouseNode) else "dds")
        client = Nav2Topics(connection)
    detector = load_detector(folder / "oranges.onnx")
    return RosRobot(connection, FrameStream(connection.address), detector, client, patience=20)


@pytest.mark.parametrize("wire", ["dds", "bridge"])
def test_the_way_that_nav2_feeds_back_is_told(wire, semantic_map, tmp_path):
    ways = list[Event]()

    def on_event(event: Event) -> None:
        if "remaining_seconds" in event.data:
            ways.append(event)

    with running(node(wire, "slow")) as made:
        options = SearchOptions(on_event=on_event, stopping=lambda: bool(ways))
        assert search(semantic_map, ["orange"], robot(made, tmp_path), options).state == "stopped"
    (way,) = ways
    assert 0 < way.data["distance"] < 8 and 0 < way.data["remaining_seconds"] < 60
    assert way.data["recoveries"] == 1
    assert way.text.startswith("on the way: ") and "had to get free once" in way.text


@pytest.mark.parametrize("wire", WIRES)
def test_where_all_goals_are_aborted_nothing_could_be_reached(wire, semantic_map, tmp_path):
    with running(node(wire, "no way")) as made:
        outcome = search(semantic_map, ["orange"], robot(made, tmp_path))
    assert outcome.state == "given up"
    assert outcome.reason == "nothing could be reached (navigation aborted)"
    assert outcome.looks == 0


@pytest.mark.parametrize("wire", ["dds", "bridge"])
def test_the_goal_under_way_is_cancelled_at_the_end(wire, semantic_map, tmp_path):
    with running(node(wire, "slow")) as made:
        options = SearchOptions(stopping=lambda: made._active is not None)
        assert search(semantic_map, ["orange"], robot(made, tmp_path), options).state == "stopped"
        if wire == "bridge":
            until(lambda: made._active is None)
            assert made._goals[-1].text == "cancelled"
        else:  # over DDS it is sent to where it is
            until(lambda: len(made._goals) > 1 and made._goals[0].text == "another goal came")
            until(lambda: made._active is None)
            assert abs(made._goals[-1].way[-1].x - made.pose.x) < 0.2


@pytest.mark.parametrize("is_taken", [True, False], ids=["taken", "sent"])
@pytest.mark.parametrize("wire", WIRES)
def test_a_server_that_dies_ends_the_search_and_no_viewpoint_counts_as_unreachable(
    wire, is_taken, semantic_map, tmp_path, monkeypatch
):
    monkeypatch.setattr(navigation, "GONE", 2.0)
    with running(node(wire, "slow")) as made:
        driven = robot(made, tmp_path)
        if not is_taken:
            made.take = lambda goal: None  # it dies before it has told that there is a goal

        def kill() -> bool:
            goal = driven._navigation._goal
            if goal is not None and goal.is_taken >= is_taken:
                made.kill_server()
            return False

        said = "is gone, with a goal under way" if is_taken else "(is gone, .*|takes no goals)"
        with pytest.raises(RobotError, match=f"/navigate_to_pose {said}; start it"):
            search(semantic_map, ["orange"], driven, SearchOptions(stopping=kill))
    (record,) = semantic_map.searches.all()
    assert record.state == "stopped"
    assert not semantic_map.searches.obstacles(record.iri)
