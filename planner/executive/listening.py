"""Hearing a robot out: where it is, what time it is there, and when it has been silent too long."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Final

from kg.errors import RobotError
from planner.executive.protocol import (
    VERSION,
    Aborted,
    Command,
    Hello,
    Message,
    Nonsense,
    RobotPose,
    Stop,
)
from planner.executive.robots import Robot

_POLL: Final = 0.2  # [s] how soon a request to stop is noticed
_JUMP: Final = 600.0  # [s] a robot's clock that moves further between two poses was set


class SearchStopped(Exception):  # noqa: N818 it is no error
    """The run ends before the search does; the message says why."""


class Listener:
    """One robot, listened to; `stopping` is asked again and again whether to end."""

    def __init__(self, robot: Robot, patience: float, stopping: Callable[[], bool]) -> None:
        self._robot = robot
        self._patience = patience
        self._stopping = stopping
        self._numbers = count(1)
        self._heard = time.monotonic()
        self._began = self._heard
        self._robot_time: float | None = None
        self._robot_seconds = 0.0
        self._last_pose: RobotPose | None = None
        self._nonsense = ""  # what the robot has said since its last message, if none of it is one

    @property
    def pose(self) -> RobotPose:
        """Where the robot last said it is; RobotError where it never did."""
        if self._last_pose is None:
            raise RobotError(f"{self._robot.name} has never said where it is")
        return self._last_pose

    @property
    def pose_if_known(self) -> RobotPose | None:
        """Where the robot last said it is, if it did."""
        return self._last_pose

    @property
    def seconds(self) -> float:
        """[s] since the beginning: by the robot's clock where it tells one, else by ours."""
        if self._robot_time is not None:
            return self._robot_seconds
        return time.monotonic() - self._began

    def greet(self) -> Hello:
        """Exchange hellos and hear where the robot is.

        Raises RobotError where it speaks another version, or says neither in time.
        """
        self.send(Hello())
        hello: Hello | None = None
        for message in self.messages(poses=True):
            if isinstance(message, Hello):
                hello = message
                self._refuse_other_version(hello)
            if hello is not None and self._last_pose is not None:
                return hello
        raise AssertionError("messages end by an exception alone")

    def next_id(self) -> int:
        """A number for the next command."""
        return next(self._numbers)

    def send(self, command: Command) -> None:
        """Tell the robot; its silence counts from now."""
        self._robot.send(command)
        self._heard = time.monotonic()

    def halt(self) -> None:
        """Have the robot stand still, whatever it is doing."""
        self.send(Stop())

    def messages(self, *, poses: bool = False, limit: float | None = None) -> Iterator[Message]:
        """What the robot says, poses being taken in; ends after `limit` seconds, if given.

        Raises SearchStopped where somebody, or the robot, ends the search, and RobotError where the
        robot is silent for longer than it has patience for.
        """
        deadline = None if limit is None else time.monotonic() + limit
        while deadline is None or time.monotonic() < deadline:
            message = self._robot.receive(_POLL)
            if self._stopping():  # what came after is not acted on any more
                raise SearchStopped("asked to stop")
            if message is None or isinstance(message, Nonsense):
                self._nonsense = message.why if message else self._nonsense
                self._refuse_silence()
                continue
            self._heard, self._nonsense = time.monotonic(), ""
            if isinstance(message, Aborted):
                raise SearchStopped(f"{self._robot.name} ends the search: {message.reason}")
            if isinstance(message, RobotPose):
                self._take_in(message)
                if not poses:
                    continue
            yield message

    def _take_in(self, pose: RobotPose) -> None:
        self._last_pose = pose
        if pose.seconds is None:
            return
        if self._robot_time is not None and 0 < pose.seconds - self._robot_time <= _JUMP:
            self._robot_seconds += pose.seconds - self._robot_time
        self._robot_time = pose.seconds

    def _refuse_silence(self) -> None:
        silent = time.monotonic() - self._heard
        if silent <= self._patience:
            return
        if self._nonsense:
            raise RobotError(
                f"{self._robot.name} has sent nothing for {silent:.0f} s that is of the protocol, "
                f"the last: {self._nonsense}; docs/ros.md has it"
            )
        raise RobotError(
            f"{self._robot.name} has been silent for {silent:.0f} s; it must send its pose "
            f"at least every {self._patience:g} s while it is busy (--patience)"
        )

    def _refuse_other_version(self, hello: Hello) -> None:
        if hello.protocol != VERSION:
            raise RobotError(
                f"{self._robot.name} speaks version {hello.protocol} of the protocol; "
                f"this is version {VERSION}"
            )
