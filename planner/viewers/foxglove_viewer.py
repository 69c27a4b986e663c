"""Foxglove: MCAP files, and a WebSocket server that Foxglove connects to."""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import foxglove
from foxglove import channels
from foxglove.websocket import ServerListener

from kg.errors import ServerError
from kg.records import RobotRecord
from perception.frames import Detections, Frame
from planner.viewers import foxglove_messages as messages
from planner.viewers.scene import Point, Scene
from planner.viewers.viewer import FLUSHED, ROUNDING, refuse_unusable, refusing

_STEP: Final = 0.1  # [m] between points of the trail
_POINTS: Final = 500  # of the trail; of a longer one every second is left out
_BACKLOG: Final = 128  # messages that wait for a slow client; then the oldest are dropped

_CHANNELS: Final[dict[str, Any]] = {
    "/camera/image": channels.CompressedImageChannel,
    "/camera/detections": channels.ImageAnnotationsChannel,
    "/camera/calibration": channels.CameraCalibrationChannel,
    "/tf": channels.FrameTransformChannel,
    "/robot/pose": channels.PoseInFrameChannel,
    "/robot/trail": channels.SceneUpdateChannel,
    "/objects": channels.SceneUpdateChannel,
    "/places": channels.SceneUpdateChannel,
    "/relations": channels.SceneUpdateChannel,
    "/plan": channels.SceneUpdateChannel,
    "/floor": channels.GridChannel,
    "/log": channels.LogChannel,
}


class FoxgloveViewer:
    """Viewer that logs Foxglove's messages to whatever sinks its `context` has."""

    def __init__(self) -> None:
        self.context = foxglove.Context()
        self._channels = {
            topic: kind(topic, context=self.context) for topic, kind in _CHANNELS.items()
        }
        self._written: dict[str, object] = {}
        self._renewed = threading.Event()
        self._moving = threading.RLock()  # held while a pose is written: by mapper and live feed
        self._trail: list[Point] = []
        self._step = _STEP
        self._robot_stamp = -math.inf  # [s] of the pose written last

    def show(self, scene: Scene, stamp: float) -> None:
        """Write the parts that changed, each as a whole."""
        if self._renewed.is_set():
            self._renewed.clear()
            self._written.clear()
            with self._moving:
                self._robot_stamp = -math.inf
                self._log_trail(stamp)
        height = scene.floor.height if scene.floor else 0.0
        for topic, part in (
            ("/objects", scene.objects),
            ("/places", scene.places),
            ("/relations", scene.relations),
            ("/floor", scene.floor),
            ("/plan", scene.plan),
        ):
            if topic in self._written and self._written[topic] == part:
                continue
            self._written[topic] = part
            self._log(topic, _MESSAGES[topic](part, height, stamp), stamp)
        with self._moving:
            if scene.robot is not None and scene.robot.stamp > self._robot_stamp + ROUNDING:
                self.robot(scene.robot)

    def frame(self, frame: Frame, detections: Detections) -> None:
        """Write image, boxes, intrinsics and camera pose."""
        stamp = frame.stamp
        self._log("/tf", messages.camera_transform(frame), stamp)
        self._log("/camera/calibration", messages.camera_calibration(frame), stamp)
        self._log("/camera/image", messages.image(frame), stamp)
        self._log("/camera/detections", messages.boxes(frame, detections), stamp)

    def robot(self, robot: RobotRecord) -> None:
        """Write pose and transform, and the trail as it grows."""
        with self._moving:
            self._robot_stamp = robot.stamp
            self._log("/tf", messages.robot_transform(robot), robot.stamp)
            self._log("/robot/pose", messages.robot_pose(robot), robot.stamp)
            x, y, z = (float(c) for c in robot.p_map)
            if self._trail and math.dist((x, y, z), self._trail[-1]) < self._step:
                return
            self._trail.append((x, y, z))
            if len(self._trail) > _POINTS:
                self._trail, self._step = self._trail[::2], 2 * self._step
            self._log_trail(robot.stamp)

    def remark(self, text: str, stamp: float) -> None:
        """Write a line of the log."""
        self._log("/log", messages.remark(text, stamp), stamp)

    def renew(self) -> None:
        """Have the next `show` write everything, changed or not; from any thread."""
        self._renewed.set()

    def close(self) -> None:
        """Nothing is left to write."""

    def _log_trail(self, stamp: float) -> None:
        if len(self._trail) > 1:
            self._log("/robot/trail", messages.trail_update(self._trail, stamp), stamp)

    def _log(self, topic: str, message: object, stamp: float) -> None:
        self._channels[topic].log(message, log_time=messages.nanoseconds_of(stamp))


_MESSAGES: Final[dict[str, Any]] = {
    "/objects": lambda part, _, stamp: messages.objects_update(part, stamp),
    "/places": lambda part, _, stamp: messages.places_update(part, stamp),
    "/relations": lambda part, _, stamp: messages.relations_update(part, stamp),
    "/floor": lambda part, _, stamp: messages.grid(part, stamp),
    "/plan": messages.plan_update,
}


class McapFile(FoxgloveViewer):
    """Viewer that writes an MCAP file as it goes; a kill loses what came in the last 5 s.

    The file is made with the first message: a run that fails before leaves none.
    """

    def __init__(self, path: Path) -> None:
        """Raises PictureError where no new file can be made at `path`."""
        super().__init__()
        refuse_unusable(path)
        self._path, self._flushed = path, time.monotonic()
        self._writer: foxglove.MCAPWriter | None = None

    def close(self) -> None:
        """Write the summary by which players jump to a moment."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with refusing(self._path):
                writer.close()

    def _log(self, topic: str, message: object, stamp: float) -> None:
        with refusing(self._path):
            if self._writer is None:
                self._writer = foxglove.open_mcap(self._path, context=self.context)
            super()._log(topic, message, stamp)
            now = time.monotonic()
            if now - self._flushed > FLUSHED:
                self._flushed = now
                self._writer.flush()


def scenes_as_mcap(scenes: Iterable[tuple[Scene, float]]) -> bytes:
    """An MCAP file of scenes, each with its time [s since 1970]."""
    viewer, file = FoxgloveViewer(), io.BytesIO()
    with foxglove.open_mcap(file, context=viewer.context):
        for scene, stamp in scenes:
            viewer.show(scene, stamp)
    return file.getvalue()


class FoxgloveServer(FoxgloveViewer):
    """Viewer that serves the Foxglove WebSocket protocol (foxglove.sdk.v1) to read from."""

    def __init__(self, title: str, host: str, port: int) -> None:
        """Raises ServerError where the port is taken or the host is not this machine's."""
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
        # by the clock, for a map's or recording's own time may lie in the past
        super()._log(topic, message, time.time())

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


class _Listener(ServerListener):
    """Writes everything again once somebody subscribes: messages are not kept for who comes."""

    def __init__(self, viewer: FoxgloveServer) -> None:
        self._viewer = viewer

    def on_subscribe(self, client: object, channel: object) -> None:
        self._viewer.renew()
        self._viewer.subscribed.set()
