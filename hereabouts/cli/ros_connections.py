"""Connections to ROS and other programs: frames, robots, and where a map is published."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from hereabouts.cli.arguments import declare, options_of, share, title_for
from hereabouts.cli.console import note
from hereabouts.cli.mapping_options import NetworkOptions, open_networks
from hereabouts.cli.recording_options import add_stream_arguments, source_options
from kg.model.errors import RecordingError
from kg.model.extensions import CONNECTIONS, extensions

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from perception.camera.poses import Pose
    from perception.sources.live.connection import Connection

    Publish = Callable[[SemanticMap, str, Callable[[], Pose]], AbstractContextManager[None]]
    from perception.sources.recording_options import RecordingOptions
    from planner.execution.robot import Robot
    from planner.execution.transports.navigation import Navigation

SOURCES: Final = (
    "ros1 or ros1://HOST:11311, ros2 or ros2://DOMAIN, ws://HOST:8765 (Foxglove), realsense, "
    "realsense:SERIAL or realsense:FILE.db3 (a recording, played), or a folder that is being "
    "written"
)
REALSENSE: Final = "realsense"
PUBLISH: Final = (
    "publish objects, floor and surface while mapping: to SOURCE itself, to ros1://HOST or "
    "ros2://DOMAIN, or serve them for Foxglove at ws://HOST:PORT"
)
_PERIOD: Final = 1.0  # [s] between two scenes that are published


def connection_to(source: str) -> Connection | None:
    """The connection to `source`; None for a folder. Raises RecordingError for neither."""
    is_address = "://" in source or source in ("ros1", "ros2")
    scheme = source.partition("://")[0] if is_address else ""
    if scheme in ("ros1", "ros2", "ws", "wss"):
        require_ros(source, "rosbags")
    if scheme == "ros1":
        from perception.sources.live.ros1 import Ros1Master

        return Ros1Master.at(source)
    if scheme == "ros2":
        require_ros(source, "cyclonedds", "dds")
        from perception.sources.live.ros2 import Ros2Domain

        return Ros2Domain.at(source)
    if scheme in extensions(CONNECTIONS):
        require_ros(source, "rosbags")
        from perception.sources.live.connection import AddedConnection

        return AddedConnection.at(source)
    if scheme in ("ws", "wss"):
        require_ros(source, "websockets")
        from perception.sources.live.foxglove import FoxgloveConnection

        return FoxgloveConnection.at(source)
    if source.partition(":")[0] == REALSENSE and not Path(source).is_dir():
        require_ros(source, "rosbags", REALSENSE)
        require_ros(source, "pyrealsense2", REALSENSE)
        from perception.sources.live.realsense import RealSenseCamera

        return RealSenseCamera.at(source)
    if source == "oak" and not Path(source).exists():
        raise RecordingError(
            "there is no driver of OAK cameras here; ros2 launch depthai_ros_driver "
            "camera.launch.py, then `hereabouts live ros2` would work"
        )
    if scheme or not Path(source).is_dir():
        raise RecordingError(f"{source!r} is no source of frames; give {SOURCES}")
    return None


def require_ros(source: str, package: str, extra: str = "ros") -> None:
    """Raise RecordingError if the package that `source` needs is missing, or does not load."""
    from importlib import import_module

    try:
        import_module(package)
    except ModuleNotFoundError as error:
        raise RecordingError(
            f"{source} needs the package {package}: pip install 'hereabouts[{extra}]'"
        ) from error
    except ImportError as error:  # pyrealsense2 needs libusb of the system
        raise RecordingError(
            f"{source} needs the package {package}, which does not load: {error}; the system's "
            "package of that library would work (libusb-1.0-0 in Debian and Ubuntu)"
        ) from error


def publish_to(arguments: argparse.Namespace, source: str) -> Publish:
    """A function that publishes a map until its context ends, by `--publish`.

    It takes the map, the frame of tf that poses are in ("" for none), and what gives the transform
    (4, 4) of that frame to the map. Raises RecordingError for a malformed address.
    """
    frames = arguments.publish_tf or ()
    if arguments.publish is None:
        if frames:
            arguments.usage_error("--publish-tf needs --publish")
        return lambda *_: nullcontext()
    to = arguments.publish or source
    scheme = to.partition("://")[0]
    if arguments.publish and scheme == "ws":
        require_ros(to, "foxglove", "foxglove")
        try:
            parts = urlsplit(to)
            host, port = parts.hostname or "127.0.0.1", parts.port
        except ValueError as error:
            raise RecordingError(f"{to!r} is no address; ws://127.0.0.1:8765 is one") from error
        port = 8765 if port is None else port
        return partial(_serve_foxglove, host, port, title_for(arguments.into), frames)
    if scheme not in ("ros1", "ros2"):
        raise RecordingError(
            f"{to!r} takes no messages; --publish ros1://HOST or ros2://DOMAIN would work, or "
            "--publish ws://127.0.0.1:8765, where Foxglove is served"
        )
    return partial(_publish_to_ros, connection_to(to), frames)


@contextmanager
def _publish_to_ros(
    to: Any,  # a master of ROS 1, or a domain of ROS 2
    frames: Sequence[str],
    semantic_map: SemanticMap,
    frame: str,
    T_map: Callable[[], Pose],
) -> Iterator[None]:
    from hereabouts.display.viewers.feed import LiveFeed
    from hereabouts.display.viewers.topic_viewer import RosViewer, published_types

    is_ros1 = to.address.startswith("ros1:")
    types = published_types(is_ros1=is_ros1)
    publisher = to.publisher(types, frozenset(types))
    viewer = RosViewer(publisher, frame, T_map, is_ros1=is_ros1)
    with LiveFeed(semantic_map, viewer, period=_PERIOD, frames=frames):
        note(f"publishing /hereabouts/objects, markers, floor and surface to {to.address}")
        yield


@contextmanager
def _serve_foxglove(
    host: str,
    port: int,
    title: str,
    frames: Sequence[str],
    semantic_map: SemanticMap,
    frame: str,
    T_map: Callable[[], Pose],
) -> Iterator[None]:
    from hereabouts.display.viewers.feed import LiveFeed
    from hereabouts.display.viewers.foxglove_viewer import FoxgloveServer

    server = FoxgloveServer(title, host, port)
    with LiveFeed(semantic_map, server, server.subscribed, period=_PERIOD, frames=frames):
        note(f"Foxglove at {server.url}")
        yield


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
