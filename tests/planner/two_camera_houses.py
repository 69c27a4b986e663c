"""The robots of houses with a second camera, which looks back, and another program that detects.

    python -m tests.planner.two_camera_houses ADDRESS

is that program: it hears the images of both cameras, and publishes the oranges in each.
"""

from __future__ import annotations

import math
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import onnx

from benchmarks.search.orange_network import orange_network
from lab.robot.ros1_node import BASE, Ros1HouseNode
from perception.inference.detector import load_detector
from perception.sources.live.cameras import CameraStreams
from perception.sources.live.connection import connection_to
from perception.sources.live.ros1 import Ros1Master
from perception.sources.live.ros1_publisher import Ros1Publisher
from perception.sources.live.ros2 import Ros2Domain
from perception.sources.live.ros2_publisher import Ros2Publisher
from perception.sources.live.topic_detector import BOXES
from perception.sources.recording_options import RecordingOptions
from perception.sources.ros.message_maker import MessageMaker
from tests.planner.nav2_house import BridgedHouseNode, FastHouseNode, Nav2HouseNode

CAMERAS = "camera", "rear"
REAR = "rear_optical_frame"
COLOUR, INFO, DEPTH = "/rear/color/image_raw/compressed", "/rear/color/camera_info", "/rear/depth/image_raw"
