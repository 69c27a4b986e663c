"""Robot protocol endpoint: the interface of a robot, its messages, and commands one at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol, runtime_checkable

from kg.model.errors import HereaboutsError, RobotError, in_one_line
from kg.model.extensions import ROBOTS, load_extension
from planner.execution.protocol import (
    Command,
    GoTo,
    Hello,
    LookAround,
    MalformedMessage,
    MalformedValueError,
    Message,
    StopCommand,
    cleaned,
    decoded,
    encoded,
    message_of,
)

MAX_MALFORMED: Final = 20  # malformed messages in a row after which a search ends


class Robot(Protocol):
    """Interface of a robot that carries out a search. Every method may raise RobotError."""

    name: str  # for people

    def send(self, command: Command) -> None:
        """Send a command; does not wait for it to be done."""

    def receive(self, seconds: float) -> Message | None:
        """The next message, or None where none came within `seconds`."""

    def close(self) -> None:
        """Close the connection and stop the robot. Closing twice is fine."""


class MessageQueue:
    """Parser of a robot's lines; malformed ones are reported, up to `MAX_MALFORMED` in a row."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._malformed = 0

    def read(self, line: bytes | str) -> Message | None:
        """The message in a line, or `MalformedMessage`; None for an unknown type.

        Raises RobotError after `MAX_MALFORMED` malformed lines in a row.
        """
        return self._read(decoded, line)

    def take(self, value: object) -> Message | None:
        """As `read`, from parsed JSON."""
        return self._read(message_of, value)

    def _read(self, reader: Callable[[Any], Message | None], received: Any) -> Message | None:
        try:
            message = reader(received)
        except MalformedValueError as error:
            line = received if isinstance(received, bytes) else str(received).encode()
            text = line.decode(errors="replace")
            return self.malformed(f"{error}: {cleaned(text[:80])!r}")
        self._malformed = 0
        return message

    def malformed(self, why: str) -> MalformedMessage:
        """Count one malformed message; raises RobotError once there are too many."""
        self._malformed += 1
        if self._malformed >= MAX_MALFORMED:
            raise RobotError(
                f"{self._name} sent {self._malformed} messages in a row that are not of the "
                f"protocol, the last one: {cleaned(why)}; see docs/reference/robot-protocol.md"
            )
        return MalformedMessage(cleaned(why))


Step = Message | None  # None: nothing yet


class StepwiseRobot(ABC):
    """Base of robots that carry out one command at a time; subclasses write the steps of each."""

    def __init__(self) -> None:
        self._under_way: Iterator[Step] = iter(())

    def send(self, command: Command) -> None:
        """Begin with `command`; the command under way is dropped."""
        if isinstance(command, Hello):
            self._under_way = self._greet()
        elif isinstance(command, GoTo):
            self._under_way = self._drive(command)
        elif isinstance(command, LookAround):
            self._under_way = self._look(command)
        elif isinstance(command, StopCommand):
            self._stop()

    def _stop(self) -> None:
        """Drop the command under way."""
        self._under_way = iter(())

    @abstractmethod
    def _greet(self) -> Iterator[Step]:
        """Steps to the description of the robot and its pose."""

    @abstractmethod
    def _drive(self, goal: GoTo) -> Iterator[Step]:
        """Steps to the goal, with the pictures on the way."""

    @abstractmethod
    def _look(self, look: LookAround) -> Iterator[Step]:
        """Steps of a turn on the spot, with its pictures."""


@runtime_checkable
class ExtensionRobot(Protocol):
    """Robot of an entry point of `hereabouts.robots`, for an address such as ``arm://left``.

    Messages of the robot protocol pass as dictionaries.
    """

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
            raise RobotError(f"{self.name}: {what}: {in_one_line(error)}") from error
