"""ROS 1 bags of a scene, for `rosbag play` and RViz."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from planner.display.viewers.ros_messages import TOPICS, RosMessages, nanoseconds_of
from planner.display.viewers.scene import Scene

_LATCHED: Final = 1


def scenes_as_bag(scenes: Iterable[tuple[Scene, float]]) -> bytes:
    """A ROS 1 bag of scenes, each with its time [s since 1970].

    Topics are latched: a later subscriber gets the last message.
    """
    types = get_typestore(Stores.ROS1_NOETIC)
    messages = RosMessages(types, is_ros1=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.bag"
        with Writer(path) as bag:
            connections = {
                topic: bag.add_connection(topic, kind, typestore=types, latching=_LATCHED)
                for topic, kind in TOPICS.items()
            }
            for scene, stamp in scenes:
                at = max(nanoseconds_of(stamp), 1)  # ROS 1 has no time 0
                for topic, message in messages.of(scene, at / 1e9):
                    data = bytes(types.serialize_ros1(message, TOPICS[topic]))
                    bag.write(connections[topic], at, data)
        return path.read_bytes()
