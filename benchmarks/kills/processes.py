"""Children that are forked, watched through a pipe, and killed.

The parent never opens a store: RocksDB's threads would not survive the fork. It has imported
everything, so that a child is at work within milliseconds.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from typing import Any


class Child:
    """A forked process that runs `work(told)`; `told(message)` reaches the parent at once."""

    def __init__(self, work: Callable[[Callable[[Any], None]], None]) -> None:
        reading, writing = os.pipe()
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            os.close(reading)
            os._exit(_run(work, writing))
        os.close(writing)
        self._reading = reading
        self._received = b""
        self.code: int | None = None

    def hear(self, within: float) -> Any:
        """The next message; raises TimeoutError after `within` [s], EOFError where it ended."""
        while b"\n" not in self._received:
            if not select.select([self._reading], [], [], within)[0]:
                raise TimeoutError(f"the child said nothing within {within:g} s")
            piece = os.read(self._reading, 1 << 16)
            if not piece:
                raise EOFError("the child ended")
            self._received += piece
        line, _, self._received = self._received.partition(b"\n")
        return json.loads(line)

    def rest(self) -> Iterator[Any]:
        """Whole messages until its end; what a kill cut off is not one."""
        while True:
            try:
                yield self.hear(120.0)
            except EOFError:
                return

    def ended(self) -> bool:
        """Whether it is gone."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if pid else None
        return self.code is not None

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        if not self.ended():
            os.kill(self.pid, signal.SIGKILL)
            self.end()

    def end(self) -> int:
        """Wait until it is gone; its exit code, negative for the signal that ended it."""
        if self.code is None:
            self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.code

    def close(self) -> None:
        """Let go of the pipe."""
        os.close(self._reading)


def _run(work: Callable[[Callable[[Any], None]], None], writing: int) -> int:
    def told(message: Any) -> None:
        os.write(writing, json.dumps(message).encode() + b"\n")

    try:
        work(told)
    except BaseException:  # noqa: BLE001 - a forked child must never return into the parent's code
        traceback.print_exc()
        sys.stderr.flush()
        return 70
    return 0
