"""Robots of extensions: messages of the robot protocol pass as dictionaries."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from kg.model.errors import HereaboutsError, RobotError
from kg.model.extensions import ROBOTS, load_extension
from planner.execution.protocol import Command, Message, encoded
from planner.execution.robot import MessageQueue


@runtime_checkable
class ExtensionRobot(Protocol):
    """What an entry point of `hereabouts.robots` returns for an address such as ``arm://left``."""

    def send(self, command: dict[str, Any]) -> None:
        """Take a command of the robot protocol; it does not wait for the robot."""

    def receive(self, seconds: float) -> dict[str, Any] | None:
        """The next message of the robot protocol; None where none came within `seconds`."""

    def close(self) -> None:
        """Stop the robot, and leave it."""


class AddedRobot:
    """A robot that an extension drives; raises RobotError where the extension fails."""

    def __init__(self, address: str) -> None:
        scheme = address.partition("://")[0]
        opened = load_extension(ROBOTS, scheme, object)
        self.name = f"the robot at {address}"
        self._inbox = MessageQueue(self.name)
        self._robot: ExtensionRobot = self._done("open", opened, address)
        if not isinstance(self._robot, ExtensionRobot):
            raise RobotError(f"{self.name}: its extension gives no robot with send, receive, close")

    def send(self, command: Command) -> None:
        """Send a command; does not wait for it to be done."""
        self._done("send", self._robot.send, encoded(command))

    def receive(self, seconds: float) -> Message | None:
        """The next message, or None where none came within `seconds`."""
        message = self._done("receive", self._robot.receive, seconds)
        return None if message is None else self._inbox.take(message)

    def close(self) -> None:
        """Stop the robot, and leave it."""
        self._done("close", self._robot.close)

    def _done(self, what: str, act: Any, *values: object) -> Any:
        try:
            return act(*values)
        except HereaboutsError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RobotError(f"{self.name}: {what}: {reason}") from error
