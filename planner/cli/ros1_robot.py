"""Options of `search` for robots behind a ROS 1 master, and the robot that they describe."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from planner.cli.arguments import add_device, positive
from planner.cli.live import require_ros
from planner.cli.models import named_detector
from planner.cli.recording_arguments import open_stream
from planner.cli.recording_options import add_intrinsics_options, add_stream_options

if TYPE_CHECKING:
    from planner.execution.robot import Robot

SHARE: Final = 0.9  # of --patience, after which this robot itself says what is missing


def is_ros1(address: str) -> bool:
    """Whether a robot's address is that of a ROS 1 master."""
    return address == "ros1" or address.startswith("ros1://")


def add_ros1_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `open_ros1_robot` reads."""
    group = parser.add_argument_group("robots of ros1://")
    group.add_argument(
        "--detector",
        default="default",
        metavar="NAME|FILE",
        help="object detector for its images (default: the bundled ones; best: the best one that "
        "can be fetched; see `hereabouts models list`)",
    )
    group.add_argument(
        "--threshold", type=positive, default=0.25, help="least detector score (default: 0.25)"
    )
    add_device(group)
    group.add_argument(
        "--navigation",
        default="/move_base",
        metavar="NAME",
        help="action server of move_base_msgs/MoveBaseAction (default: /move_base)",
    )
    group.add_argument(
        "--base-frame",
        metavar="FRAME",
        help="the robot's frame in tf (default: base_link, base_footprint, else the camera's)",
    )
    add_intrinsics_options(group)
    add_stream_options(group)
    defaults = {option.dest: option.default for option in group._group_actions}
    parser.set_defaults(ros1_defaults=defaults)


def refuse_ros1_options(arguments: argparse.Namespace) -> None:
    """Refuse what only these robots have, as wrong usage."""
    for name, default in arguments.ros1_defaults.items():
        if getattr(arguments, name) != default:
            arguments.usage_error(f"--{name.replace('_', '-')} is for --robot ros1://HOST")


def open_ros1_robot(arguments: argparse.Namespace) -> Robot:
    """The robot that the options describe; raises HereaboutsError before it is moved."""
    require_ros(arguments.robot, "rosbags")
    from perception.inference.recorded_detections import open_detector
    from perception.live.ros1 import Ros1Master
    from planner.execution.ros1_robot import Ros1Robot

    master = Ros1Master.at(arguments.robot)
    name = named_detector(arguments.detector)
    detector = open_detector(name, threshold=arguments.threshold, device=arguments.device)
    return Ros1Robot(
        master,
        open_stream(master.address, arguments),
        detector,
        navigation=arguments.navigation,
        base=arguments.base_frame,
        patience=SHARE * arguments.patience,
    )
