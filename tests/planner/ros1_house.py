"""A house behind a ROS 1 master, to be searched for an orange."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import onnx

from benchmarks.search.orange_network import orange_network
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, PlaceRecord
from lab.robot.ros1_node import Ros1HouseNode
from perception.inference.detector import load_detector
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.stream import FrameStream
from planner.execution.transports.navigation import MoveBase
from planner.execution.transports.ros_robot import RosRobot
from planner.simulation.house import House, Item, furnished_house

ORANGE = np.array([7.05, 8.30, 0.89])  # [m] its middle
START = 4.7, 8.2  # [m] in the same room


def house() -> House:
    return furnished_house().with_objects([Item("orange", 7.05, 8.30, 0.85)])


def add_dining_room(semantic_map: SemanticMap) -> None:
    (room,) = (room for room in house().rooms if room.name == "dining room")
    kind = semantic_map.catalogue.find(room.category, "place").iri
    edges = room.xmin, room.xmax, room.ymin, room.ymax
    place = PlaceRecord(semantic_map.place_iri(1), room.name, *edges, 20, {kind: 0.9})
    semantic_map.apply(MapUpdate(places=(place,)))


@contextmanager
def running(node: Ros1HouseNode) -> Iterator[Ros1HouseNode]:
    ended = threading.Event()
    thread = threading.Thread(target=node.run, args=(ended,))
    thread.start()
    try:
        yield node
    finally:
        ended.set()
        thread.join()


def robot(master: Ros1Master, folder: Path, **settings: Any) -> RosRobot:
    network = folder / "oranges.onnx"
    onnx.save(orange_network(), network)
    stream = FrameStream(master.address)
    return RosRobot(master, stream, load_detector(network), MoveBase(master), **settings)
