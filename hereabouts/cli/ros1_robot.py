"""Options of `search` for robots behind a ROS 1 master, and the robot that they describe."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import add_device, share
from hereabouts.cli.network_options import NetworkOptions, open_networks
from hereabouts.cli.recording_options import add_stream_arguments, stream_options
from hereabouts.cli.ros_connections import require_ros

if TYPE_CHECKING:
    from perception.sources.recording_options import RecordingOptions
    from planner.execution.robot import Robot

#: share of --patience after which the robot reports missing messages
SHARE: Final = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros1Options:
    """Options of a robot behind a ROS 1 master."""

    networks: NetworkOptions
    topics: RecordingOptions
    navigation: str  # action server of move_base
    base: str | None  # frame of the robot's base in tf
    patience: float  # [s] that navigation, images and poses may take


def is_ros1(address: str) -> bool:
    """Whether a robot's address is that of a ROS 1 master."""
    return address == "ros1" or address.startswith("ros1://")


def add_ros1_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `ros1_options` reads."""
    group = parser.add_argument_group("robots of ros1://")
    group.add_argument(
        "--detector",
        default="default",
        metavar="NAME|FILE",
        help="object detector for its images; best: the best detector, downloaded if needed "
        "(default: the bundled ones; see `hereabouts models list`)",
    )
    group.add_argument(
        "--threshold", type=share, default=0.25, help="minimum score of a detection (default: 0.25)"
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
        help="frame of the robot in tf (default: base_link, base_footprint, else the camera's)",
    )
    add_stream_arguments(group)
    defaults = {option.dest: option.default for option in group._group_actions}
    parser.set_defaults(ros1_defaults=defaults)


def check_no_ros1_arguments(arguments: argparse.Namespace) -> None:
    """End the program, as wrong usage, if an argument of ROS 1 robots is given."""
    for name, default in arguments.ros1_defaults.items():
        if getattr(arguments, name) != default:
            arguments.usage_error(f"--{name.replace('_', '-')} needs --robot ros1://HOST")


def ros1_options(arguments: argparse.Namespace) -> Ros1Options:
    """Options of the robot; raises RecordingError for unreadable intrinsics."""
    return Ros1Options(
        networks=NetworkOptions(
            detector=arguments.detector, threshold=arguments.threshold, device=arguments.device
        ),
        topics=stream_options(arguments),
        navigation=arguments.navigation,
        base=arguments.base_frame,
        patience=SHARE * arguments.patience,
    )


def open_ros1_robot(address: str, options: Ros1Options) -> Robot:
    """The robot behind the master at `address`; raises HereaboutsError before it is moved."""
    require_ros(address, "rosbags")
    from perception.sources.live.ros1 import Ros1Master
    from perception.sources.live.stream import FrameStream
    from planner.execution.transports.ros1_robot import Ros1Robot

    master = Ros1Master.at(address)
    return Ros1Robot(
        master,
        FrameStream(master.address, options.topics),
        open_networks(options.networks).detector,
        navigation=options.navigation,
        base=options.base,
        patience=options.patience,
    )
