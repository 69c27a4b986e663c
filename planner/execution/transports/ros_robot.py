"""Robot of ROS 1 or ROS 2: navigation drives it; its camera is read from topics, its pose from tf.

For a view, it turns by goals on the spot, with an overlapping picture at each. Detections in
pictures on the way are reported as they come. There is one goal at a time.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from kg.model.areas import MAX_COORDINATE
from kg.model.errors import RobotError
from perception.camera.poses import Pose
from perception.frames import Detector, Frame
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live.connection import Connection
from perception.sources.live.stream import FrameStream
from perception.sources.ros.image_messages import NANOSECONDS
from planner.execution.protocol import (
    Arrived,
    DetectedFrame,
    DetectionsMessage,
    Failed,
    GoTo,
    Hello,
    LookAround,
    Message,
    RobotPose,
)
from planner.execution.robot import Step, StepwiseRobot
from planner.execution.transports.navigation import GoalPose, Navigation

BASES: Final = ("base_link", "base_footprint")  # frames that robots usually have
OVERLAP: Final = 0.7  # turn between two pictures, as a share of the field of view
PICTURE_WITHIN: Final = 10.0  # [s] after the robot stands still
LEAVE_WITHIN: Final = 5.0  # [s] for the threads of the connection
_TICK: Final = 0.1  # [s]

_FORWARD, _OPTICAL = 0, 2  # axes along the view of robots and of cameras


@dataclass(frozen=True, slots=True)
class _Location:
    """Pose of the robot in the map frame."""

    x: float  # [m] of its base
    y: float
    heading: float  # [rad] of its camera
    offset: float  # [rad] from the heading of its base to the left to that of its camera
    stamp: float  # [s] by the robot's clock


@dataclass(frozen=True, slots=True)
class _Inboxes:
    """Forward messages to the camera's frames and to navigation."""

    stream: FrameStream
    navigation: Navigation

    def wanted(self, topics: Mapping[str, str]) -> set[str]:
        """Topics that either wants."""
        return self.stream.wanted(topics) | self.navigation.wanted(topics)

    def offer(self, raw: RawMessage, *, is_ros1: bool) -> None:
        """Pass a message to both; each ignores the messages of the other."""
        self.stream.offer(raw, is_ros1=is_ros1)
        self.navigation.offer(raw, is_ros1=is_ros1)


class RosRobot(StepwiseRobot):
    """A `Robot` that `navigation` drives; messages come through `connection`.

    `base` is its frame in tf; by default one of BASES, else the colour camera's. `patience` [s]
    bounds the wait for navigation, images and poses; RobotError then names the missing one.
    """

    def __init__(
        self,
        connection: Connection,
        stream: FrameStream,
        detector: Detector,
        navigation: Navigation,
        *,
        base: str | None = None,
        patience: float = 30.0,
    ) -> None:
        super().__init__()
        self.name = f"the robot at {connection.address}"
        self._stream, self._detector, self._base, self._patience = stream, detector, base, patience
        self._navigation = navigation
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=connection.run, args=(_Inboxes(stream, navigation), self._ended), daemon=True
        )
        self._thread.start()
        self._field_of_view = 0.0  # [rad] of the camera, across
        self._latest = math.nan, time.monotonic()  # stamp of the latest pose, and when it came

    def receive(self, seconds: float) -> Message | None:
        """The next message; None where none came within `seconds`."""
        until = time.monotonic() + seconds
        while True:
            step = next(self._under_way, None)
            left = until - time.monotonic()
            if step is not None or left <= 0:
                return step
            time.sleep(min(left, _TICK / 10))

    def _stop(self) -> None:
        super()._stop()
        try:
            here = self._goal_at(self._location()) if self._stream.choice else None
        except RobotError:  # its pose is unknown
            here = None
        self._navigation.cancel(here)

    def close(self) -> None:
        """Cancel the goal under way, and leave."""
        self._stop()
        self._navigation.close()
        self._ended.set()
        self._thread.join(LEAVE_WITHIN)

    def _greet(self) -> Iterator[Step]:
        until = time.monotonic() + self._patience
        while not self._navigation.ready:
            self._check_late(until, self._navigation.missing)
            yield None
        frame: Frame | None = None
        while frame is None:
            silence = self._stream.silence()
            missing = silence.line if silence else "no images with depth and a pose"
            self._check_late(until, missing)
            frame = self._stream.next_frame(_TICK)
            yield None
        self._field_of_view = 2 * math.atan(frame.rgb.shape[1] / 2 / float(frame.K[0, 0]))
        yield Hello(name=self.name, field_of_view=self._field_of_view, detector=self._detector.name)
        yield self._pose()

    def _check_late(self, until: float, missing: str) -> None:
        if time.monotonic() > until:
            raise RobotError(f"{self.name}: {missing}, for {self._patience:.0f} s (--patience)")

    def _drive(self, goal: GoTo) -> Iterator[Step]:
        """Drive to a goal; detections in pictures on the way are reported."""
        self._go(goal.x, goal.y, goal.heading)
        outcome = yield from self._until_over(pictures=True)
        yield Failed(goal.id, outcome) if outcome else Arrived(goal.id)

    def _look(self, look: LookAround) -> Iterator[Step]:
        """Turn on the spot by goals, and take a picture after each."""
        start = self._pose()
        turns = math.ceil(abs(look.turn) / (OVERLAP * self._field_of_view) - 1e-6)
        views = list[DetectedFrame]()
        for number in range(turns + 1):
            if number:
                self._go(start.x, start.y, start.heading + look.turn * number / turns)
                outcome = yield from self._until_over(pictures=False)
                if outcome:
                    yield Failed(look.id, outcome)
                    return
            frame = yield from self._picture_after(self._pose().seconds or 0.0)
            if frame is None:
                yield Failed(look.id, f"no picture for {PICTURE_WITHIN:g} s")
                return
            views.append(self._view(frame))
        yield DetectionsMessage(look.id, views=tuple(views))

    def _until_over(self, *, pictures: bool) -> Generator[Step, None, str]:
        """Poses until the goal is over, with `pictures` too; returns its `Navigation.outcome`."""
        while (outcome := self._navigation.outcome()) is None:
            yield self._pose()
            if (way := self._navigation.way()) is not None:
                yield way
            frame = self._stream.next_frame(_TICK) if pictures else None
            if frame is not None:
                view = self._view(frame)
                yield DetectionsMessage(None, pose=self._pose_of(frame), views=(view,))
            elif not pictures:
                self._ended.wait(_TICK)
        yield self._pose()
        return outcome

    def _view(self, frame: Frame) -> DetectedFrame:
        return DetectedFrame(frame, self._detector.detect(frame))

    def _picture_after(self, since: float) -> Generator[Step, None, Frame | None]:
        """A frame taken at `since` [s by the robot's clock] or later; None if none comes."""
        until = time.monotonic() + PICTURE_WITHIN
        while time.monotonic() < until:
            frame = self._stream.next_frame(_TICK)
            if frame is not None and float(frame.id) >= since:
                return frame
            yield self._pose()
        return None

    def _go(self, x: float, y: float, heading: float) -> None:
        """Send a goal at (x, y) [m] at which the camera has the heading `heading` [rad]."""
        here = self._location()
        self._navigation.send(self._goal_at(replace(here, x=x, y=y, heading=heading)))

    def _goal_at(self, at: _Location) -> GoalPose:
        choice, stamp = self._stream.choice, round(max(at.stamp, 0.0) * NANOSECONDS)
        assert choice is not None  # there were frames
        return GoalPose(at.x, at.y, at.heading - at.offset, choice.map_frame, stamp)

    def _pose(self) -> RobotPose:
        here = self._location()
        return RobotPose(here.x, here.y, here.heading, here.stamp)

    def _pose_of(self, frame: Frame) -> RobotPose:
        """Position and heading of the camera of a picture."""
        x, y, _ = (float(c) for c in frame.T_map_cam[:3, 3])
        return RobotPose(x, y, _heading(frame.T_map_cam, _OPTICAL))

    def _location(self) -> _Location:
        """Latest pose of the robot; raises RobotError where there was none for `patience`."""
        choice, now = self._stream.choice, time.monotonic()
        assert choice is not None  # there were frames
        camera = self._stream.latest_pose(choice.colour.frame)
        names = [self._base] if self._base else BASES
        base = next(filter(None, map(self._stream.latest_pose, names)), None)
        if self._base and base is None:
            raise RobotError(f"{self.name}: tf has no frame {self._base} (--base-frame)")
        if camera is None:
            raise RobotError(f"{self.name}: no transforms link {choice.colour.frame} to the map")
        T, stamp = base or camera
        if stamp != self._latest[0]:
            self._latest = stamp, now
        if now - self._latest[1] > self._patience:
            silent = now - self._latest[1]
            raise RobotError(f"{self.name}: tf has had no new pose for {silent:.0f} s (--patience)")
        x, y, heading = float(T[0, 3]), float(T[1, 3]), _heading(camera[0], _OPTICAL)
        if not max(abs(x), abs(y)) <= MAX_COORDINATE:
            raise RobotError(f"{self.name}: tf has it at ({x:g}, {y:g}) m, which is nowhere")
        offset = 0.0 if base is None else heading - _heading(T, _FORWARD)
        return _Location(x, y, heading, offset, stamp)


def _heading(T: Pose, axis: int) -> float:
    """Heading [rad] of an axis of the frame whose pose is `T` (4, 4), seen from above."""
    return math.atan2(float(T[1, axis]), float(T[0, axis]))
