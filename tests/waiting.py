"""Processes that tests start, and waiting: for a condition, not for a time."""

import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable

#: the command line, as a process of its own
HEREABOUTS = (sys.executable, "-m", "hereabouts.cli")


def until(condition: Callable[[], object], what: str = "", seconds: float = 120.0) -> None:
    """Return once `condition()` is true; AssertionError with `what` where it stays false."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what or f"not within {seconds:g} s"
        time.sleep(0.02)


def listens(port: int, server: subprocess.Popen[bytes]) -> bool:
    """Whether a port of this machine accepts connections, perhaps after a while; False where the
    server ended instead."""

    def answered() -> bool:
        with socket.socket() as attempt:
            return attempt.connect_ex(("127.0.0.1", port)) == 0

    until(lambda: answered() or server.poll() is not None, f"nobody listens at {port}")
    return server.poll() is None


def program(text: str, *words: object) -> subprocess.Popen[str]:
    """A Python program as a process of its own, whose output is read."""
    return subprocess.Popen(
        [sys.executable, "-c", text, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def told_until_killed(process: subprocess.Popen[str], rng: random.Random) -> int:
    """The last number that a program prints which is killed within 0.1 s of its first one."""
    assert process.stdout is not None
    first = process.stdout.readline()
    time.sleep(rng.uniform(0.0, 0.1))
    process.kill()
    out, err = process.communicate()
    assert process.returncode == -signal.SIGKILL, err
    return max(map(int, f"{first}{out}".split("\n")[:-1]))
