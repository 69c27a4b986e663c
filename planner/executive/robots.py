"""A robot as a search sees it, and the patience with what real ones send."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

from kg.errors import RobotError
from planner.executive.protocol import (
    Command,
    MalformedError,
    Message,
    Nonsense,
    cleaned,
    decoded,
    message_of,
)

#: Messages in a row that make no sense, after which a robot is given up.
MOST_NONSENSE: Final = 20


class Robot(Protocol):
    """What carries out a search. Every method may raise RobotError."""

    name: str  # for people

    def send(self, command: Command) -> None:
        """Tell it what to do; does not wait for it."""

    def receive(self, seconds: float) -> Message | None:
        """The next message, or None where none came within `seconds`."""

    def close(self) -> None:
        """Let go of it; it must stand still then. Closing twice is fine."""


class Inbox:
    """Lines of a robot to messages; what makes no sense is said to be so, up to a point."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._nonsense = 0

    def read(self, line: bytes | str) -> Message | None:
        """The message in a line, `Nonsense` where there is none; None for a type not known.

        Raises RobotError after `MOST_NONSENSE` lines in a row that were no messages.
        """
        return self._read(decoded, line)

    def take(self, value: object) -> Message | None:
        """As `read`, of JSON that is parsed already."""
        return self._read(message_of, value)

    def _read(self, reader: Callable[[Any], Message | None], said: Any) -> Message | None:
        try:
            message = reader(said)
        except MalformedError as error:
            text = said.decode(errors="replace") if isinstance(said, bytes) else str(said)
            return self.nonsense(f"{error}: {cleaned(text[:80])!r}")
        self._nonsense = 0
        return message

    def nonsense(self, why: str) -> Nonsense:
        """Count one message that makes no sense; raises RobotError once there are too many."""
        self._nonsense += 1
        if self._nonsense >= MOST_NONSENSE:
            raise RobotError(
                f"{self._name} sent {self._nonsense} messages in a row that are not of the "
                f"protocol, the last one: {cleaned(why)}; docs/ros.md has it"
            )
        return Nonsense(cleaned(why))
