"""Connections to ROS and other programs: where frames come from, and where a map is published."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from hereabouts.cli.arguments import title_for
from hereabouts.cli.console import note
from kg.model.errors import RecordingError
from kg.model.extensions import CONNECTIONS, extensions

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap
    from perception.camera.poses import Pose
    from perception.sources.live.connection import Connection
    from perception.sources.live.ros1 import Ros1Master
    from perception.sources.live.ros2 import Ros2Domain

    Publish = Callable[[SemanticMap, str, Callable[[], Pose]], AbstractContextManager[None]]

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
    if arguments.publish is None:
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
        return partial(_serve_foxglove, host, port, title_for(arguments.into))
    if scheme not in ("ros1", "ros2"):
        raise RecordingError(
            f"{to!r} takes no messages; --publish ros1://HOST or ros2://DOMAIN would work, or "
            "--publish ws://127.0.0.1:8765, where Foxglove is served"
        )
    require_ros(to, "rosbags")
    if scheme == "ros2":
        require_ros(to, "cyclonedds", "dds")
        from perception.sources.live.ros2 import Ros2Domain

        return partial(_publish_to_ros, Ros2Domain.at(to))
    from perception.sources.live.ros1 import Ros1Master

    return partial(_publish_to_ros, Ros1Master.at(to))


@contextmanager
def _publish_to_ros(
    to: Ros1Master | Ros2Domain, semantic_map: SemanticMap, frame: str, T_map: Callable[[], Pose]
) -> Iterator[None]:
    from hereabouts.display.viewers.feed import LiveFeed
    from hereabouts.display.viewers.topic_viewer import RosViewer, published_types
    from perception.sources.live.ros1 import Ros1Master

    is_ros1 = isinstance(to, Ros1Master)
    types = published_types(is_ros1=is_ros1)
    publisher: Any
    if isinstance(to, Ros1Master):
        from perception.sources.live.ros1_publisher import Ros1Publisher

        publisher = Ros1Publisher(to, types, frozenset(types))
    else:
        from perception.sources.live.ros2_publisher import Ros2Publisher

        publisher = Ros2Publisher(to, types, frozenset(types))
    viewer = RosViewer(publisher, frame, T_map, is_ros1=is_ros1)
    with LiveFeed(semantic_map, viewer, period=_PERIOD):
        note(f"publishing /hereabouts/objects, markers, floor and surface to {to.address}")
        yield


@contextmanager
def _serve_foxglove(
    host: str,
    port: int,
    title: str,
    semantic_map: SemanticMap,
    frame: str,
    T_map: Callable[[], Pose],
) -> Iterator[None]:
    from hereabouts.display.viewers.feed import LiveFeed
    from hereabouts.display.viewers.foxglove_viewer import FoxgloveServer

    server = FoxgloveServer(title, host, port)
    with LiveFeed(semantic_map, server, server.subscribed, period=_PERIOD):
        note(f"Foxglove at {server.url}")
        yield
