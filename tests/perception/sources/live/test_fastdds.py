"""What we publish in a ROS 2 domain, as Fast DDS hears it: the DDS of Humble and Jazzy."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds")
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.ros.message_maker import MessageMaker
from tests.perception.sources.live.test_ros2 import DOMAIN

SOURCES = Path(__file__).with_name("fastdds")
KIND, TOPIC = "vision_msgs/msg/Detection3DArray", "/hereabouts/objects"

if not (shutil.which("fastddsgen") and shutil.which("g++")):
    pytest.skip("no Fast DDS here: apt-get install libfastrtps-dev fastddsgen g++",
                allow_module_level=True)  # fmt: skip


def test_a_late_subscriber_of_fast_dds_hears_the_last_message(tmp_path: Path) -> None:
    def run(*words: str) -> None:
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)

    for path in SOURCES.iterdir():
        shutil.copy(path, tmp_path)
    run("fastddsgen", "-replace", "Objects.idl")
    files = ("subscriber.cpp", "Objects.cxx", "ObjectsPubSubTypes.cxx")
    run("g++", "-std=c++14", *files, "-o", "subscriber", "-lfastrtps", "-lfastcdr")
    publisher = Ros2Publisher(Ros2Domain(DOMAIN + 3), {TOPIC: KIND}, frozenset([TOPIC]))
    try:
        result = [{"hypothesis": {"class_id": "cup", "score": 0.5}}]
        box = {"center": {"position": {"x": 1.5}}, "size": {"z": 0.25}}
        found = [{"id": name, "results": result, "bbox": box} for name in ("object/1", "object/23")]
        make = MessageMaker(is_ros1=False)
        message = make.make(KIND, header={"frame_id": "hereabouts"}, detections=found)
        publisher.publish(TOPIC, message)
        command = [str(tmp_path / "subscriber"), str(DOMAIN + 3)]
        heard = subprocess.run(command, check=True, capture_output=True, text=True, timeout=90)
    finally:
        publisher.close()
    assert heard.stdout.strip() == "hereabouts|object/1,cup,1.5,0.25|object/23,cup,1.5,0.25"
