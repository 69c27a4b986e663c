"""Options of `search` for robots of ROS 1 and ROS 2, and the robot that they describe."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import declare, options_of, share
from hereabouts.cli.network_options import NetworkOptions, open_networks
from hereabouts.cli.recording_options import add_stream_arguments, source_options
from hereabouts.cli.ros_connections import connection_to

if TYPE_CHECKING:
    from perception.sources.recording_options import RecordingOptions
    from planner.execution.robot import Robot
    from planner.execution.transports.navigation import Navigation

#: share of --patience after which the robot reports missing messages
SHARE: Final = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class RosOptions:
    """Options of a robot of ROS."""

    networks: NetworkOptions
    topics: RecordingOptions
    navigation: str | None  # name of its action
    base: str | None  # frame of the robot's base in tf
    patience: float  # [s] that navigation, images and poses may take


def is_ros(address: str) -> bool:
    """Whether a robot's address is that of a ROS 1 master, a ROS 2 domain or foxglove_bridge."""
    return address.partition("://")[0] in ("ros1", "ros2", "ws", "wss")


_ROS_ARGUMENTS = """
--detector NAME|FILE   object detector for its images; best: the best detector, downloaded if
                       needed; topic:NAME: detections of another program (default: the bundled ones;
                       see `hereabouts models list`)
--threshold THRESHOLD  minimum score of a detection (default: 0.25)
--device
--navigation NAME      action that drives the robot (default: /move_base of ROS 1, /navigate_to_pose
                       of Nav2)
--base-frame FRAME     frame of the robot in tf (default: base_link, base_footprint, else the
                       camera's)
"""


def add_ros_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `ros_options` reads."""
    group = parser.add_argument_group("robots of ros1://, ros2:// and ws://")
    declare(
        group,
        _ROS_ARGUMENTS,
        detector={"default": "default"},
        threshold={"type": share, "default": 0.25},
    )
    add_stream_arguments(group)
    parser.set_defaults(ros_options=group._group_actions)


def check_no_ros_arguments(arguments: argparse.Namespace) -> None:
    """End the program, as wrong usage, if an argument of these robots is given."""
    for option in arguments.ros_options:
        if getattr(arguments, option.dest) != option.default:
            name = option.option_strings[0]
            arguments.usage_error(f"{name} needs --robot ros1://HOST, ros2://DOMAIN or ws://HOST")


def ros_options(arguments: argparse.Namespace) -> RosOptions:
    """Options of the robot; raises RecordingError for unreadable intrinsics."""
    return RosOptions(
        networks=options_of(NetworkOptions, arguments),
        topics=source_options(arguments),
        navigation=arguments.navigation,
        base=arguments.base_frame,
        patience=SHARE * arguments.patience,
    )


def open_ros_robot(address: str, options: RosOptions) -> Robot:
    """The robot at `address`; raises HereaboutsError before it is moved."""
    connection = connection_to(address)
    from perception.sources.live.foxglove import FoxgloveConnection
    from perception.sources.live.ros1 import Ros1Master
    from perception.sources.live.ros2 import Ros2Domain
    from perception.sources.live.stream import FrameStream
    from perception.sources.live.topic_detector import TopicDetector
    from planner.execution.transports.navigation import MoveBase, Nav2Services, Nav2Topics
    from planner.execution.transports.ros_robot import RosRobot

    detector, name = open_networks(options.networks, live=True).detector, options.navigation
    topic = detector if isinstance(detector, TopicDetector) else None
    navigation: Navigation
    if isinstance(connection, Ros1Master):
        navigation = MoveBase(connection, name or "/move_base")
    elif isinstance(connection, Ros2Domain):
        navigation = Nav2Topics(connection, name or "/navigate_to_pose")
    else:
        assert isinstance(connection, FoxgloveConnection)
        navigation = Nav2Services(connection, name or "/navigate_to_pose")
    return RosRobot(
        connection,
        FrameStream(connection.address, options.topics, topic),
        detector,
        navigation,
        base=options.base,
        patience=options.patience,
    )
