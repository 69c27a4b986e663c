"""All at once, over each wire: two cameras, a program that detects, a viewer, and a search."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
pytest.importorskip("onnx")
from hereabouts.cli.ros_connections import connection_to
from kg.serving.opening import open_map
from perception.sources.bags.bag_file import RawMessage
from tests.perception.sources.live import fast_dds
from tests.perception.sources.live.debian_ros import free_port, started
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK
from tests.planner.ros1_house import ORANGE
from tests.waiting import listens, until

NO_ROS = pytest.mark.skipif(
    not shutil.which("rosmaster"), reason="no ROS 1: apt-get install ros-core"
)
NO_FAST = pytest.mark.skipif(not fast_dds.is_there(), reason=fast_dds.REASON)
WIRES = [
    pytest.param("ros1", marks=NO_ROS),
    "dds",
    pytest.param("fast dds", marks=NO_FAST),
    "bridge",
]


class _Viewer:
    """Another program, which hears what is published of the objects."""

    def __init__(self) -> None:
        self.heard = 0

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        return topics.keys() & {"/hereabouts/objects", "/hereabouts/markers"}

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        self.heard += b"orange" in raw.data


@pytest.mark.parametrize("wire", WIRES)
def test_a_robot_maps_shows_and_searches(
    wire: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port, into, said, viewer = free_port(), tmp_path / "a.map", tmp_path / "said", _Viewer()
    for name, value in {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(tmp_path),
        **({} if wire == "fast dds" else {"CYCLONEDDS_URI": LOOPBACK}),  # it needs multicast
    }.items():
        monkeypatch.setenv(name, value)
    (tmp_path / "labels.csv").write_text("1,orange\n")  # ROS 1 has numbers for categories
    labels = ["--labels-map", str(tmp_path / "labels.csv")] * (wire == "ros1")

    def command(*words: str, **pipes: Any) -> subprocess.Popen[str]:
        running = subprocess.Popen([sys.executable, "-m", *words], text=True, **pipes)
        stack.enter_context(running)
        stack.callback(running.kill)
        return running

    with ExitStack() as stack:
        address = f"ros2://{DOMAIN + 3 + 2 * (wire == 'fast dds')}"
        if wire == "ros1":
            core = ("rosmaster", "--core", "-p", str(port))
            assert listens(port, stack.enter_context(started(dict(os.environ), *core)))
            address = f"ros1://127.0.0.1:{port}"
        house = command("tests.planner.two_camera_house", wire, address, stdout=subprocess.PIPE)
        assert house.stdout is not None
        address = house.stdout.readline().strip()

        words = ["live", address, "--into", str(into), "--camera", "camera", "--camera", "rear@1"]
        words += ["--detector", "topic:/{camera}/detections", "--scene", "none", "--publish"]
        words += ["ws://127.0.0.1:0"] * (wire == "bridge")
        errors = stack.enter_context(said.open("w"))
        live = command("hereabouts.cli", *words, *labels, stderr=errors)
        until(lambda: re.search("publishing|Foxglove at", said.read_text()))
        shown = re.search(r"Foxglove at (\S+)", said.read_text())
        published = connection_to(shown[1] if shown else address)
        assert published is not None
        ended = threading.Event()
        stack.callback(ended.set)
        threading.Thread(target=published.run, args=(viewer, ended), daemon=True).start()
        until(lambda: re.search(r"^\d+ frames", said.read_text(), re.MULTILINE))
        heard = viewer.heard

        words = ["search", str(into), "orange", "--robot", address, "--patience", "60"]
        words += ["--color-topic", "/camera/color/image_raw/compressed"]
        search = command(
            "hereabouts.cli", *words, "--detector", "topic:/camera/detections", *labels,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        told = search.communicate()[0]
        assert search.returncode == 0, told
        assert live.poll() is None
        until(lambda: viewer.heard > heard)
        live.send_signal(signal.SIGINT)
        assert live.wait() == 0, said.read_text()
    with open_map(into, read_only=True) as semantic_map:
        (record,) = semantic_map.searches.all()
        (orange,) = semantic_map.objects("orange", min_existence=0.5)
        (recording,) = semantic_map.recordings()
    assert record.state == "found" and record.found == (orange.iri,)
    assert np.linalg.norm(orange.p_map - ORANGE) < 0.1
    assert recording.frames_applied >= 4
    assert re.search("camera rear: [1-9]", said.read_text())
