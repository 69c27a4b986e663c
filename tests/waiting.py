"""Waiting in tests: for a condition, not for a time."""

from __future__ import annotations

import time
from collections.abc import Callable


def until(condition: Callable[[], object], what: str = "", seconds: float = 120.0) -> None:
    """Return once `condition()` is true; AssertionError with `what` where it stays false."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what or f"not within {seconds:g} s"
        time.sleep(0.02)
