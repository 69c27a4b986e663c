"""Foxglove: MCAP files, and a WebSocket server that Foxglove connects to."""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import foxglove
from foxglove import Channel, Schema
from foxglove.mcap import MCAPWriteOptions
from foxglove.websocket import ServerListener

from hereabouts.display.viewers.ros_messages import LIVE_TOPICS, TOPICS, RosMessages, nanoseconds_of
from hereabouts.display.viewers.scene import Point, Scene
from hereabouts.display.viewers.topic_viewer import TopicViewer
from hereabouts.display.viewers.viewer import FLUSHED, ROUNDING, check_new_file, picture_errors
from kg.model.errors import ServerError
from kg.model.records import RobotRecord
from perception.frames import Detections, Frame
from perception.sources.ros.message_types import message_types, serialised

_STEP: Final = 0.1  # [m] between points of the trail
_MAX_POINTS: Final = 500  # of the trail; above it every second point is dropped
_BACKLOG: Final = 128  # messages that wait for a slow client; then the oldest are dropped
_KINDS: Final = TOPICS | LIVE_TOPICS
_ROS2: Final = MCAPWriteOptions(profile="ros2")


class FoxgloveViewer(TopicViewer):
    """Viewer that logs messages of ROS 2 to the sinks of its `context`."""

    def __init__(self) -> None:
        self.context = foxglove.Context()
        super().__init__(RosMessages(is_ros1=False))
        self._channels = {topic: self._channel(topic, kind) for topic, kind in _KINDS.items()}
        self._moving = threading.RLock()  # held by mapper or live feed while a pose is written
        self._trail: list[Point] = []
        self._step = _STEP
        self._robot_stamp = -math.inf  # [s] of the pose written last

    def _channel(self, topic: str, kind: str) -> Channel:
        definition = message_types(False).generate_msgdef(kind, ros_version=2)[0].encode()
        schema = Schema(name=kind, encoding="ros2msg", data=definition)
        return Channel(topic, schema=schema, message_encoding="cdr", context=self.context)

    def show(self, scene: Scene, stamp: float) -> None:
        """Write what changed, and the robot where it moved."""
        super().show(scene, stamp)
        with self._moving:
            if scene.robot is not None and scene.robot.stamp > self._robot_stamp + ROUNDING:
                self.robot(scene.robot)

    def _start_again(self, stamp: float) -> None:
        with self._moving:
            self._robot_stamp = -math.inf
            self._log_trail(stamp)

    def frame(self, frame: Frame, detections: Detections) -> None:
        """Write the camera's pose and intrinsics, and the image with boxes."""
        for topic, message in self._messages.camera(frame, detections):
            self._log(topic, message, frame.stamp)

    def robot(self, robot: RobotRecord) -> None:
        """Write pose and transform, and the trail as it grows."""
        with self._moving:
            self._robot_stamp = robot.stamp
            self._log("/tf", self._messages.robot_transform(robot), robot.stamp)
            pose = self._messages.robot(robot, robot.stamp)
            self._log("/hereabouts/robot", pose, robot.stamp)
            x, y, z = (float(c) for c in robot.p_map)
            if self._trail and math.dist((x, y, z), self._trail[-1]) < self._step:
                return
            self._trail.append((x, y, z))
            if len(self._trail) > _MAX_POINTS:
                self._trail, self._step = self._trail[::2], 2 * self._step
            self._log_trail(robot.stamp)

    def remark(self, text: str, stamp: float) -> None:
        """Write a line of the log."""
        self._log("/rosout", self._messages.log(text, stamp), stamp)

    def close(self) -> None:
        """Nothing is left to write."""

    def _log_trail(self, stamp: float) -> None:
        if len(self._trail) > 1:
            self._log("/hereabouts/trail", self._messages.way(self._trail, stamp), stamp)

    def _log(self, topic: str, message: object, stamp: float) -> None:
        data = serialised(_KINDS[topic], message, is_ros1=False)
        self._channels[topic].log(data, log_time=nanoseconds_of(stamp))


class McapFile(FoxgloveViewer):
    """Viewer that writes an MCAP file as it goes; a kill loses at most the last 5 s.

    The file is created with the first message, so a run that fails earlier leaves no file.
    """

    def __init__(self, path: Path) -> None:
        """Raises PictureError where no new file can be made at `path`."""
        super().__init__()
        check_new_file(path)
        self._path, self._flushed = path, time.monotonic()
        self._writer: foxglove.MCAPWriter | None = None

    def close(self) -> None:
        """Write the summary, by which players jump to a moment."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with picture_errors(self._path):
                writer.close()

    def _log(self, topic: str, message: object, stamp: float) -> None:
        with picture_errors(self._path):
            if self._writer is None:
                self._writer = foxglove.open_mcap(
                    self._path, context=self.context, writer_options=_ROS2
                )
            super()._log(topic, message, stamp)
            now = time.monotonic()
            if now - self._flushed > FLUSHED:
                self._flushed = now
                self._writer.flush()


def scenes_as_mcap(scenes: Iterable[tuple[Scene, float]]) -> bytes:
    """An MCAP file of scenes, each with its time [s since 1970]."""
    viewer, file = FoxgloveViewer(), io.BytesIO()
    with foxglove.open_mcap(file, context=viewer.context, writer_options=_ROS2):
        for scene, stamp in scenes:
            viewer.show(scene, stamp)
    return file.getvalue()


class FoxgloveServer(FoxgloveViewer):
    """Viewer that serves the Foxglove WebSocket protocol (foxglove.sdk.v1) to read from."""

    def __init__(self, title: str, host: str, port: int) -> None:
        """Raises ServerError if the port is taken or the host is not this machine's."""
        super().__init__()
        self.subscribed = threading.Event()  # set whenever a client subscribes to a topic
        try:
            self._server = foxglove.start_server(
                name=title,
                host=host,
                port=port,
                capabilities=[],
                server_listener=_Listener(self),
                context=self.context,
                message_backlog_size=_BACKLOG,
            )
        except (OSError, RuntimeError, ValueError, OverflowError) as error:
            raise ServerError(f"cannot serve Foxglove at {host}:{port}: {error}") from error
        self.url = f"ws://{host}:{self._server.port}"

    def _log(self, topic: str, message: object, stamp: float) -> None:
        # by the clock, since the time of a map or recording may be in the past
        super()._log(topic, message, time.time())

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


class _Listener(ServerListener):
    """Writes everything again for a new subscriber, since the server keeps no messages."""

    def __init__(self, viewer: FoxgloveServer) -> None:
        self._viewer = viewer

    def on_subscribe(self, client: object, channel: object) -> None:
        self._viewer.renew()
        self._viewer.subscribed.set()
