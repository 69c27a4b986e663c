"""Stepwise robot: commands carried out one at a time, as generators of messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from planner.execution.protocol import Command, GoTo, Hello, LookAround, Message, StopCommand

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
