"""Feeds a viewer with a map while it is mapped, searched with, or served."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hereabouts.display.viewers.scene import ScenePlan, SceneReader, SceneStop
from hereabouts.display.viewers.viewer import Viewer
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HereaboutsError
from kg.model.records import RobotRecord
from mapping.frames.projection import LeadingCamera, robot_at
from perception.frames import Detections, Frame, SceneScores
from planner.execution.options import Event
from planner.execution.protocol import Command, DetectionsMessage, Message, RobotPose
from planner.execution.robot import Robot

_PERIOD: Final = 1.0  # [s] by the frames' stamps between scenes
_LIVE_PERIOD: Final = 0.5  # [s] between scenes that are served


class MappingFeed:
    """Feeds a viewer while frames are mapped: each frame, and the scene once a second of them."""

    def __init__(self, semantic_map: SemanticMap, viewer: Viewer) -> None:
        self._reader, self._viewer = SceneReader(semantic_map), viewer
        self._stamp: float | None = None  # [s] of the last frame
        self._shown = -math.inf
        self._robot = LeadingCamera()

    def on_detections(
        self, frame: Frame, detections: Detections, scores: SceneScores | None
    ) -> None:
        """Show a mapped frame; `map_recording` calls this."""
        self._stamp = frame.stamp
        self._viewer.frame(frame, detections)
        if (robot := self._robot.at(frame)) is not None:
            self._viewer.robot(robot)
        if abs(frame.stamp - self._shown) >= _PERIOD:
            self.show(fresh=False)

    def show(self, *, fresh: bool = True) -> None:
        """Show the scene as it is now; without `fresh`, with a surface some seconds old."""
        scene, stamp = self._reader.read(fresh=fresh), self._stamp
        if stamp is None:  # all frames were mapped before
            stamp = time.time() if scene.robot is None else scene.robot.stamp
        self._shown = stamp
        self._viewer.show(scene, stamp)


def show_frame(viewer: Viewer, frame: Frame, detections: Detections) -> None:
    """Show a frame, and the robot at the pose of its camera."""
    viewer.frame(frame, detections)
    viewer.robot(robot_at(frame))


class LiveFeed:
    """Shows the scene of an open map whenever it changes, on a thread of its own."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        viewer: Viewer,
        wake: threading.Event | None = None,
        *,
        period: float = _LIVE_PERIOD,
        frames: Sequence[str] = (),
    ) -> None:
        """`frames` as of `SceneReader`, and raises what it does; `period` [s] is between scenes."""
        self._period, self._map, self._viewer = period, semantic_map, viewer
        self._reader = SceneReader(semantic_map, frames=frames)
        self._wake = wake or threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hereabouts-viewer", daemon=True)

    def __enter__(self) -> LiveFeed:
        self._unsubscribe = self._map.subscriptions.listen(lambda change: self._wake.set())
        self._wake.set()
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._unsubscribe()
        self._ended.set()
        self._wake.set()
        self._thread.join()
        self._viewer.close()

    def _run(self) -> None:
        while self._wake.wait() and not self._ended.is_set():
            self._wake.clear()
            try:
                self._viewer.show(self._reader.read(), time.time())
            except HereaboutsError as error:
                # for example while the ontology is replaced; the next change is shown again
                self._viewer.remark(str(error), time.time())
            self._ended.wait(self._period)


class SearchFeed:
    """Feeds a viewer during a search: plan and remarks by its events, the robot by its messages.

    `clock` [s since 1970] is the clock of the search.
    """

    def __init__(
        self, semantic_map: SemanticMap, viewer: Viewer, clock: Callable[[], float]
    ) -> None:
        self._map, self._viewer, self._clock = semantic_map, viewer, clock
        self._reader = SceneReader(semantic_map)
        self._plan: ScenePlan | None = None
        self._at: RobotPose | None = None

    def on_event(self, event: Event) -> None:
        """Show an event of the search."""
        stamp = self._clock()
        if event.kind == "plan":
            self._plan = self._planned(event)
        elif event.kind in ("found", "end"):
            self._plan = None
        self._viewer.remark(event.text, stamp)
        self._viewer.show(self._reader.read(self._plan), stamp)

    def on_pose(self, pose: RobotPose) -> None:
        """Show the robot at `pose`."""
        self._at = pose
        known = self._map.robot()
        height = 0.0 if known is None else float(known.p_map[2])
        p_map = np.array([pose.x, pose.y, height])
        self._viewer.robot(RobotRecord(p_map, pose.heading, self._clock()))

    def _planned(self, event: Event) -> ScenePlan:
        data = event.data
        goal = float(data["x"]), float(data["y"])
        start = goal if self._at is None else (self._at.x, self._at.y)
        text = next(iter(data["why"]), event.text)
        return ScenePlan((start, goal), (SceneStop(goal, float(data["heading"]), str(text)),))


class WatchedRobot:
    """A robot whose poses are passed on to a feed as they arrive."""

    def __init__(self, robot: Robot, feed: SearchFeed) -> None:
        self._robot, self._feed, self.name = robot, feed, robot.name

    def send(self, command: Command) -> None:
        """Forward to the robot."""
        self._robot.send(command)

    def receive(self, seconds: float) -> Message | None:
        """Forward to the robot."""
        message = self._robot.receive(seconds)
        if isinstance(message, RobotPose):
            self._feed.on_pose(message)
        elif isinstance(message, DetectionsMessage) and message.pose is not None:
            self._feed.on_pose(message.pose)
        return message

    def close(self) -> None:
        """Forward to the robot."""
        self._robot.close()
