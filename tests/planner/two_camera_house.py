"""A process of its own: a robot with two cameras in a house, and another program that detects.

    python -m tests.planner.two_camera_house ros1|dds|"fast dds"|bridge ADDRESS

The robot drives to goals. Its second camera looks back. The other program detects oranges in the
images of both, and publishes its boxes. The address under which all this is to be had is printed.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final

import onnx

from benchmarks.search.orange_network import orange_network
from lab.robot.ros1_node import BASE, Ros1HouseNode
from perception.inference.detector import load_detector
from perception.sources.bag_writer import CAMERA, COLOUR, COLOUR_INFO, DEPTH
from perception.sources.live.cameras import CameraStreams
from perception.sources.live.foxglove import FoxgloveConnection
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.topic_detector import BOXES
from perception.sources.recording_options import RecordingOptions
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.message_maker import MessageMaker
from tests.planner.nav2_house import BridgedHouseNode, FastHouseNode, Nav2HouseNode
from tests.planner.ros1_house import START, house

ORANGES: Final = 1  # number of the category, which ROS 1 has instead of a name
FRAMES: Final = {"camera": CAMERA, "rear": "rear_optical_frame"}
BEHIND: Final = math.pi  # [rad]
THEIRS: Final = {f"/{name}/detections": BOXES for name in FRAMES}
IMAGES: Final = {
    topic: topic.replace("/camera/", "/rear/") for topic in (COLOUR, COLOUR_INFO, DEPTH)
}


NODES: Final = {
    "ros1": Ros1HouseNode,
    "dds": Nav2HouseNode,
    "fast dds": FastHouseNode,
    "bridge": BridgedHouseNode,
}


class _TwoCameras(Ros1HouseNode):
    """A robot whose second camera looks back."""

    CAMERA_AND_TF: ClassVar = {  # type: ignore[misc]
        **Ros1HouseNode.CAMERA_AND_TF,
        **{rear: Ros1HouseNode.CAMERA_AND_TF[front] for front, rear in IMAGES.items()},
        **THEIRS,
    }

    def _mounted(self) -> Any:
        message = super()._mounted()
        pose = self._camera.model.pose(0.0, 0.0, BEHIND)
        rear = self._maker.transforms(self._stamp, BASE, FRAMES["rear"], pose)
        message.transforms = [*message.transforms, *rear.transforms]
        return message

    def _publish_picture(self) -> None:
        super()._publish_picture()
        colour, info, depth = IMAGES.values()
        self._publish_view(BEHIND, FRAMES["rear"], colour, depth, [info])


def detect(connection: Any, publish: Callable[[str, Any], None], *, is_ros1: bool) -> None:
    """The other program: it hears images, and publishes what it detects in each."""
    with TemporaryDirectory() as folder:
        onnx.save(orange_network(), Path(folder) / "oranges.onnx")
        network = load_detector(Path(folder) / "oranges.onnx")
    cameras = CameraStreams(connection.address, list(FRAMES), RecordingOptions())
    threading.Thread(target=connection.run, args=(cameras, threading.Event()), daemon=True).start()
    make = MessageMaker(is_ros1)
    while True:
        frame = cameras.next_frame(0.1)
        if frame is None:
            continue
        name, _, stamp = frame.id.partition("-")
        seconds, _, rest = stamp.partition(".")
        header = make.header(int(seconds) * NANOSECONDS + int(rest), FRAMES[name])
        found, boxes = network.detect(frame), []
        for (x1, y1, x2, y2), score in zip(found.xyxy.tolist(), found.score.tolist(), strict=True):
            x, y = (x1 + x2) / 2, (y1 + y2) / 2
            middle = {"x": x, "y": y} if is_ros1 else {"position": {"x": x, "y": y}}
            kind = (
                {"id": ORANGES, "score": score}
                if is_ros1
                else {"hypothesis": {"class_id": "orange", "score": score}}
            )
            bbox = {"center": middle, "size_x": x2 - x1, "size_y": y2 - y1}
            boxes.append({"header": header, "bbox": bbox, "results": [kind]})
        publish(f"/{name}/detections", make.make(BOXES, header=header, detections=boxes))


def main(wire: str, address: str) -> None:
    is_ros1 = wire == "ros1"
    master: Any = Ros1Master.at(address) if is_ros1 else Ros2Domain.at(address)
    made: Any = type("Robot", (_TwoCameras, NODES[wire]), {})(master, house(), START)
    made.pose = replace(made.pose, heading=math.pi / 2)  # neither camera sees the orange
    connection = FoxgloveConnection.at(made.url) if wire == "bridge" else master
    publish = made._publisher.publish
    words = {"is_ros1": is_ros1}
    threading.Thread(target=detect, args=(connection, publish), kwargs=words, daemon=True).start()
    sys.stdout.write(f"{connection.address}\n")
    sys.stdout.flush()
    made.run(threading.Event())


if __name__ == "__main__":
    main(*sys.argv[1:])
