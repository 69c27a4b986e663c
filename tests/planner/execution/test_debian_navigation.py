"""A search over ROS itself: Debian's master, and rospy's actionlib as server and as client."""

import os
import shutil
import subprocess
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("onnx")
from kg.serving.opening import in_memory_map
from lab.robot.ros1_node import Ros1HouseNode
from perception.sources.live.ros1 import Ros1Master
from planner.execution.options import Event, SearchOptions
from planner.execution.search_loop import search
from tests.perception.sources.live.debian_ros import free_port, started
from tests.planner.ros1_house import ORANGE, START, add_dining_room, house, robot, running

PYTHON = "/usr/bin/python3"
SCRIPT = Path(__file__).with_name("rospy_navigation.py")

if (
    not shutil.which("rosmaster")
    or subprocess.run(
        [PYTHON, "-c", "import actionlib, move_base_msgs.msg, rospy"],
        check=False,
        capture_output=True,
    ).returncode
):
    pytest.skip(
        "no ROS 1 here: apt-get install ros-core python3-actionlib python3-move-base-msgs",
        allow_module_level=True,
    )


def test_a_thing_is_found_through_actionlib(tmp_path: Path) -> None:
    port = free_port()
    environment = {
        **os.environ,
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(tmp_path),
    }
    master, events = Ros1Master("127.0.0.1", port), list[Event]()
    node = Ros1HouseNode(master, house(), START, rate=5, navigation="/house/move_base")
    with ExitStack() as stack:
        stack.enter_context(started(environment, "rosmaster", "--core", "-p", str(port)))
        stack.enter_context(running(node))
        stack.enter_context(started(environment, PYTHON, str(SCRIPT)))
        semantic_map = stack.enter_context(in_memory_map())
        add_dining_room(semantic_map)
        node.pose = type(node.pose)(*START, np.pi, node.seconds)  # with its back to it
        options = SearchOptions(on_event=events.append)
        outcome = search(semantic_map, ["orange"], robot(master, tmp_path), options)
        assert outcome.state == "found", [event.text for event in events]
        (orange,) = semantic_map.objects("orange")
        assert np.linalg.norm(orange.p_map - ORANGE) < 0.1
        surprises = [event.text for event in events if event.kind == "surprise"]
        assert all("looking again" in text for text in surprises), surprises
        assert node._goals
