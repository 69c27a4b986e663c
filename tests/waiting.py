"""Waiting in tests: for a condition, not for a time."""

import socket
import subprocess
import time
from collections.abc import Callable


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
