"""Robot session: hello, pose, clock and timeout of one robot."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Final

from kg.model.errors import RobotError
from planner.execution.protocol import (
    VERSION,
    Aborted,
    Arrived,
    Blocked,
    Command,
    DetectionsMessage,
    Failed,
    GoTo,
    Hello,
    LookAround,
    MalformedMessage,
    Message,
    RobotPose,
    StopCommand,
)
from planner.execution.robot import Robot

_POLL: Final = 0.2  # [s] between two checks for a request to stop
LATE: Final = 5.0  # times the expected seconds after which a robot is late
_TURN_SPEED: Final = 0.1  # [rad/s] of the slowest robot
_MAX_STEP: Final = 600.0  # [s] between two poses by the robot's clock; a larger step is an error


class SearchStopped(Exception):  # noqa: N818 it is no error
    """The run was stopped before the search was over; the message has the reason."""


class RobotSession:
    """Session with one robot; ends once `stopping()` is true. `timeout` [s] bounds its silence."""

    def __init__(self, robot: Robot, timeout: float, stopping: Callable[[], bool]) -> None:
        self._robot = robot
        self._timeout = timeout
        self._stopping = stopping
        self._numbers = count(1)
        self._last_message = time.monotonic()
        self._began = self._last_message
        self._robot_time: float | None = None
        self._robot_seconds = 0.0
        self._last_pose: RobotPose | None = None
        self._malformed = ""  # reason why the last line was malformed

    @property
    def pose(self) -> RobotPose:
        """Last pose that the robot sent; raises RobotError without one."""
        if self._last_pose is None:
            raise RobotError(f"{self._robot.name} has never sent its pose")
        return self._last_pose

    @property
    def pose_if_known(self) -> RobotPose | None:
        """Last pose that the robot sent, if any."""
        return self._last_pose

    @property
    def seconds(self) -> float:
        """[s] since the beginning: by the robot's clock if its poses have times, else by ours."""
        if self._robot_time is not None:
            return self._robot_seconds
        return time.monotonic() - self._began

    def greet(self) -> Hello:
        """Exchange hellos and wait for the first pose.

        Raises RobotError for another version of the protocol, and at the timeout.
        """
        self.send(Hello())
        hello: Hello | None = None
        for message in self.messages(poses=True):
            if isinstance(message, Hello):
                hello = message
                self._check_version(hello)
            if hello is not None and self._last_pose is not None:
                return hello
        raise AssertionError("messages end by an exception alone")

    def next_id(self) -> int:
        """Return the number of the next command."""
        return next(self._numbers)

    def send(self, command: Command) -> None:
        """Send a command; the timeout counts from now."""
        self._robot.send(command)
        self._last_message = time.monotonic()

    def halt(self) -> None:
        """Send a stop command."""
        self.send(StopCommand())

    def look_around(self, turn: float, extent: float) -> DetectionsMessage | Failed:
        """Detections of a look `extent` [rad] wide that begins after a turn by `turn` [rad]."""
        number = self.next_id()
        self.send(LookAround(number, turn, extent))
        limit = 2 * self._timeout + LATE * 2 * math.pi / _TURN_SPEED
        for message in self.messages(limit=limit):
            if isinstance(message, DetectionsMessage) and message.id == number:
                return message
            if isinstance(message, Failed) and message.id in (number, None):
                return message
        return Failed(number, f"no detections after {limit:.0f} s")

    def go_to(self, x: float, y: float, heading: float) -> Iterator[Message]:
        """Drive to (x, y) [m] nearby with `heading` [rad]; messages until it arrives or fails."""
        number = self.next_id()
        self.send(GoTo(number, x, y, heading))
        for message in self.messages(limit=2 * self._timeout):
            yield message
            if isinstance(message, Blocked | Failed) or message == Arrived(number):
                return

    def messages(self, *, poses: bool = False, limit: float | None = None) -> Iterator[Message]:
        """Messages of the robot until `limit` [s], without poses unless `poses`.

        Raises SearchStopped once a request or the robot ends the search, and RobotError once the
        robot is silent for longer than the timeout.
        """
        deadline = None if limit is None else time.monotonic() + limit
        while deadline is None or time.monotonic() < deadline:
            message = self._robot.receive(_POLL)
            if self._stopping():
                raise SearchStopped("asked to stop")
            if message is None or isinstance(message, MalformedMessage):
                self._malformed = message.why if message else self._malformed
                self._check_silence()
                continue
            self._last_message, self._malformed = time.monotonic(), ""
            if isinstance(message, Aborted):
                raise SearchStopped(f"{self._robot.name} ends the search: {message.reason}")
            if isinstance(message, RobotPose):
                self._update_pose(message)
                if not poses:
                    continue
            yield message

    def _update_pose(self, pose: RobotPose) -> None:
        self._last_pose = pose
        if pose.seconds is None:
            return
        if self._robot_time is not None and 0 < pose.seconds - self._robot_time <= _MAX_STEP:
            self._robot_seconds += pose.seconds - self._robot_time
        self._robot_time = pose.seconds

    def _check_silence(self) -> None:
        silent = time.monotonic() - self._last_message
        if silent <= self._timeout:
            return
        if self._malformed:
            raise RobotError(
                f"{self._robot.name} has sent nothing for {silent:.0f} s that is of the protocol, "
                f"the last: {self._malformed}; see docs/reference/robot-protocol.md"
            )
        raise RobotError(
            f"{self._robot.name} has been silent for {silent:.0f} s; it must send its pose "
            f"at least every {self._timeout:g} s while it is busy (--patience)"
        )

    def _check_version(self, hello: Hello) -> None:
        if hello.protocol != VERSION:
            raise RobotError(
                f"{self._robot.name} speaks version {hello.protocol} of the protocol; "
                f"this is version {VERSION}"
            )
