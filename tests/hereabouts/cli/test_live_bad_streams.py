"""`hereabouts live` from a robot that does something wrong: a line, and mapping goes on."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cyclonedds")
from hereabouts.cli import main
from kg.serving.opening import create_map, open_map
from mapping.mapper import Mapper
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.ros.message_maker import MessageMaker
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import furnished_house
from tests.perception.sources.live.drifting_robot import COLOUR, DEPTH, INFO, TYPES, flat
from tests.perception.sources.live.ros1_master import fake_master
from tests.perception.sources.live.test_ros2 import DOMAIN, LOOPBACK
from tests.waiting import until

ROS2 = f"ros2://{DOMAIN}"
HEAR = """
import sys, time
from perception.sources.live.ros2 import Ros2Domain
import threading
class Inbox:
    def wanted(self, topics): return {t for t in topics if t.startswith("/hereabouts/")}
    def offer(self, raw, *, is_ros1): print(raw.topic, flush=True)
Ros2Domain(int(sys.argv[1])).run(Inbox(), threading.Event())
"""


@dataclass(frozen=True)
class Fault:
    """What the robot does wrong."""

    apart: tuple[float, float] = (0.0, 0.0)  # [s] of depth's and of tf's clock from that of colour
    width: int = 160  # [px] of colour
    boxes: int = 1  # detections of an image
    quality: bool = False  # whether nothing is reliable, and nothing latched


class BestEffort(Ros2Publisher):
    """A publisher of sensor data alone."""

    def _writer(self, topic: str, *, latched: bool) -> Any:
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.topic import Topic

        from perception.sources.live.ros2 import TOPIC_PREFIX, idl_type

        made = Topic(self._participant, f"{TOPIC_PREFIX}{topic}", idl_type(self._types[topic]))
        quality = Qos(
            Policy.Reliability.BestEffort, Policy.DataRepresentation(use_cdrv0_representation=True)
        )
        return DataWriter(self._participant, made, qos=quality)


@contextmanager
def robot(fault: Fault, *, is_ros1: bool = False) -> Iterator[str]:
    """Address of a robot that stands and sways, five images a second."""
    height = fault.width * 3 // 4
    model = CameraModel(width=160, height=120, focal=140.0)
    camera, make, over = (
        SimulatedCamera(furnished_house(), model),
        MessageMaker(is_ros1),
        threading.Event(),
    )
    kind, latched = BestEffort if fault.quality else Ros2Publisher, frozenset(["/tf_static"])
    stack, address = ExitStack(), ROS2
    publisher: Ros1Publisher | Ros2Publisher
    if is_ros1:
        master = stack.enter_context(fake_master()).address
        publisher, address = Ros1Publisher(master, TYPES, latched), master.address
    else:
        publisher = kind(Ros2Domain(DOMAIN), TYPES, latched)
    mount, big = model.pose(0.0, 0.0, 0.0), fault.width // 160

    def tell() -> None:
        n = 0
        while not over.wait(0.2):
            n, now = n + 1, time.time_ns()
            base = flat(5.7 + 0.02 * (n % 9), 4.7, 0.05 * (n % 7))
            at = now + round(fault.apart[1] * 1e9)
            publisher.publish("/tf", make.transforms(at, "map", "base_link", base))
            publisher.publish("/tf_static", make.transforms(0, "base_link", "camera", mount))
            frame = camera.frame(str(n), base @ mount, now / 1e9)
            header = make.header(now, "camera")
            if n == 1 or big == 1:  # enlarging takes its time
                rgb = np.kron(frame.rgb, np.ones((big, big, 1), np.uint8))
                depth = np.kron(frame.depth, np.ones((big, big), np.float32))
            K = np.diag([big, big, 1.0]) @ frame.K
            publisher.publish(INFO, make.camera_info(K, (height, fault.width), header))
            publisher.publish(COLOUR, make.image(rgb, "rgb8", header))
            late = make.header(now + round(fault.apart[0] * 1e9), "camera")
            publisher.publish(DEPTH, make.depth(depth, late))
            middle: dict[str, Any] = {"x": 80.0, "y": 60.0}
            result: dict[str, Any] = {"id": 47, "score": 0.9}
            if not is_ros1:
                middle = {"position": middle}
                result = {"hypothesis": {"class_id": "cup", "score": 0.9}}
            box = {"center": middle, "size_x": 40.0, "size_y": 30.0}
            boxes = [{"header": header, "bbox": box, "results": [result]}] * fault.boxes
            found = make.make(TYPES["/detections"], header=header, detections=boxes)
            publisher.publish("/detections", found)

    thread = threading.Thread(target=tell)
    thread.start()
    try:
        yield address
    finally:
        over.set()
        thread.join()
        publisher.close()
        stack.close()


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)


def live(into: Path, *words: str, address: str = ROS2) -> int:
    common = ["live", address, "--into", str(into), "--scene", "none"]
    if address != ROS2:
        labels = into.with_name("labels.csv")
        labels.write_text("47,cup\n")
        common += ["--labels-map", str(labels)]
    return main([*common, "--detector", "topic:/detections", *words])


@pytest.mark.parametrize(
    ("wire", "fault", "words", "code", "said"),
    [
        (
            "ros1",
            Fault(),
            ["--color-topic", "/none"],
            1,
            "'/none' is no topic of its kind; there are: /camera/color/",
        ),
        ("dds", Fault(), ["--loops", "/none"], 0, "no message of /none came that tells a path"),
        ("dds", Fault(apart=(1000.0, 0.0)), [], 1, "without depth"),
        ("ros1", Fault(apart=(0.0, -1000.0)), [], 1, "without pose"),
        ("dds", Fault(apart=(500.0, -1000.0)), [], 1, "without depth"),
        ("dds", Fault(width=3040), [], 0, "frames mapped"),
        ("ros1", Fault(width=3040), [], 0, "frames mapped"),
        ("dds", Fault(boxes=1000), [], 0, "1000 detections of one image; the best 300 count"),
        ("ros1", Fault(boxes=1000), [], 0, "1000 detections of one image; the best 300 count"),
        ("dds", Fault(quality=True), [], 0, "frames mapped"),
    ],
    ids=[
        *("topic", "loops", "depth's clock", "tf's clock", "three clocks", "20 MB"),
        *("20 MB, ROS 1", "storm", "storm, ROS 1", "QoS"),
    ],
)
def test_a_line_says_what_is_wrong(wire, fault, words, code, said, tmp_path, capsys, caplog):
    into = tmp_path / "a.map"
    with robot(fault, is_ros1=wire == "ros1") as address:
        # where nothing can be mapped, this is how long the test takes
        idle = "6" if code else "15"
        ended = live(into, "--limit", "3", "--idle", idle, *words, address=address)
    lines = capsys.readouterr().err + caplog.text
    assert "Traceback" not in lines
    assert said in lines, lines
    assert ended == code, lines
    if code:
        assert not into.exists()
        return
    with open_map(into, read_only=True) as semantic_map:
        (recording,) = semantic_map.recordings()
    assert recording.frames_applied == 3


def test_a_second_node_of_one_map_is_refused_and_the_first_goes_on(tmp_path, capsys):
    into = tmp_path / "a.map"
    with create_map(into) as semantic_map, Mapper(semantic_map, recording="live"), robot(Fault()):
        assert live(into, "--limit", "2", "--idle", "8") == 1
        last = capsys.readouterr().err.splitlines()[-1]
        assert last.startswith("error: ") and "another" in last
    with robot(Fault()):
        assert live(into, "--limit", "2") == 0


def test_a_subscriber_that_stalls_does_not_hold_up_mapping(tmp_path: Path) -> None:
    heard = tmp_path / "heard"
    with (
        heard.open("w") as file,
        subprocess.Popen([sys.executable, "-c", HEAR, str(DOMAIN)], stdout=file) as stalls,
        robot(Fault()),
    ):

        def stall() -> None:
            until(lambda: "/hereabouts/objects" in heard.read_text())
            stalls.send_signal(signal.SIGSTOP)

        thread = threading.Thread(target=stall)
        thread.start()
        began = time.monotonic()
        try:
            assert live(tmp_path / "a.map", "--publish", "--limit", "25") == 0
            assert time.monotonic() - began < 120
            thread.join()
        finally:
            stalls.send_signal(signal.SIGCONT)
            stalls.kill()
