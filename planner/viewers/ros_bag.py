"""ROS 1 bags of a scene, for `rosbag play` and RViz."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from planner.viewers.ros_messages import TOPICS, RosMessages, nanoseconds_of
from planner.viewers.scene import Scene

_LATCHED: Final = 1


def scene_as_bag(scene: Scene, stamp: float) -> bytes:
    """A ROS 1 bag with one message a topic, which whoever subscribes later gets as well."""
    types = get_typestore(Stores.ROS1_NOETIC)
    at = max(nanoseconds_of(stamp), 1)  # ROS 1 has no time 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.bag"
        with Writer(path) as bag:
            for topic, message in RosMessages(types).of(scene, at / 1e9):
                kind = TOPICS[topic]
                connection = bag.add_connection(topic, kind, typestore=types, latching=_LATCHED)
                bag.write(connection, at, bytes(types.serialize_ros1(message, kind)))
        return path.read_bytes()
