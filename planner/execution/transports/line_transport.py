"""Line transport: a robot program that we start, or the program that started us."""

from __future__ import annotations

import contextlib
import os
import selectors
import shlex
import subprocess
import sys
import time
from collections import deque
from typing import Final

from kg.model.errors import RobotError
from planner.execution.protocol import MAX_LINE, Command, Message, StopCommand, line_of
from planner.execution.robot import MessageQueue

_CHUNK: Final = 1 << 16
_WRITE_WITHIN: Final = 10.0  # [s] a robot reads a command within this
_LEAVE_WITHIN: Final = 3.0  # [s] a program has to end after its stdin was closed


class Lines:
    """Lines from a file descriptor, with a time limit. None stands for a line over MAX_LINE."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._part = bytearray()
        self._lines: deque[bytes | None] = deque()
        self._skipping = False  # within a line that is too long
        self.ended = False

    def next(self, seconds: float) -> bytes | EOFError | None:
        """The next line; None for a line that is too long; EOFError (not raised) after the last.

        Raises TimeoutError where no whole line came within `seconds`.
        """
        deadline = time.monotonic() + seconds
        while not self._lines:
            if self.ended:
                return EOFError()
            if not _ready(self._descriptor, selectors.EVENT_READ, deadline - time.monotonic()):
                raise TimeoutError
            self._take(os.read(self._descriptor, _CHUNK))
            if not self._lines and not self.ended and time.monotonic() > deadline:
                raise TimeoutError  # data without an end of line
        return self._lines.popleft()

    def _take(self, data: bytes) -> None:
        self.ended = not data
        *whole, rest = data.split(b"\n")
        for piece in whole:
            self._part += piece
            too_long = self._skipping or len(self._part) > MAX_LINE
            self._lines.append(None if too_long else bytes(self._part))
            self._part.clear()
            self._skipping = False
        self._part += rest
        if len(self._part) > MAX_LINE:
            self._skipping = True
            self._part.clear()


class LineRobot:
    """A robot at the other end of two pipes."""

    def __init__(self, name: str, reads: int, writes: int) -> None:
        self.name = name
        self._lines = Lines(reads)
        self._writes = writes
        self._inbox = MessageQueue(name)

    def send(self, command: Command) -> None:
        """Write the command as a line; raises RobotError where the robot does not read it."""
        left = line_of(command)
        deadline = time.monotonic() + _WRITE_WITHIN
        while left:
            if not _ready(self._writes, selectors.EVENT_WRITE, deadline - time.monotonic()):
                raise RobotError(f"{self.name} has not read a command for {_WRITE_WITHIN:g} s")
            try:
                left = left[os.write(self._writes, left) :]
            except OSError as error:
                raise RobotError(f"{self.name} has ended{self._how()}") from error

    def receive(self, seconds: float) -> Message | None:
        """The next message; None where none came in time. Raises RobotError at the end."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                line = self._lines.next(max(0.0, deadline - time.monotonic()))
            except TimeoutError:
                return None
            except OSError as error:
                raise RobotError(f"{self.name} cannot be read ({error.strerror})") from error
            if isinstance(line, EOFError):
                raise RobotError(f"{self.name} has ended{self._how()}")
            if line is None:
                return self._inbox.malformed(f"a line of more than {MAX_LINE} bytes")
            if line.strip() and (message := self._inbox.read(line)) is not None:
                return message

    def close(self) -> None:
        """Send a stop command."""
        with contextlib.suppress(RobotError):
            self.send(StopCommand())

    def _how(self) -> str:
        return ""


class ChildRobot(LineRobot):
    """A program started by us; its stderr is ours."""

    def __init__(self, command: str) -> None:
        """Start `command`, with words split as by a shell, but without a shell.

        Raises RobotError where the program cannot be started.
        """
        if not command.strip():
            raise RobotError("stdio: needs a command to start, e.g. 'stdio:python3 bridge.py'")
        try:
            words = shlex.split(command)
            # a separate session: Ctrl+C reaches us alone, and we stop the robot
            self._process = subprocess.Popen(
                words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        except (OSError, ValueError, IndexError) as error:
            reason = getattr(error, "strerror", None) or error
            raise RobotError(f"cannot start the robot {command!r}: {reason}") from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        super().__init__(
            f"the robot {words[0]!r}", self._process.stdout.fileno(), self._process.stdin.fileno()
        )
        self._open = True

    def close(self) -> None:
        """Send a stop command, close stdin, and kill the process if it does not end."""
        if not self._open:
            return
        self._open = False
        if self._process.poll() is None:
            super().close()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(OSError):
                pipe.close()
        try:
            self._process.wait(_LEAVE_WITHIN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _how(self) -> str:
        try:
            return f" with exit code {self._process.wait(_LEAVE_WITHIN)}"
        except subprocess.TimeoutExpired:
            return ""


def on_our_own_pipes() -> LineRobot:
    """The robot that started us: it reads our stdout and writes our stdin."""
    sys.stdout.flush()
    return LineRobot("the robot on stdin", sys.stdin.fileno(), sys.stdout.fileno())


def _ready(descriptor: int, event: int, seconds: float) -> bool:
    with selectors.DefaultSelector() as selector:
        try:
            selector.register(descriptor, event)
        except PermissionError:  # a plain file is always ready
            return True
        return bool(selector.select(max(0.0, seconds)))
