"""Whose turn it is: questions about the past leave a worker free for those about the present.

A state of the past may take seconds to be made, and a history long to be told. However many ask for
that, who asks how it is now finds a worker; a pool of one worker has only one line.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from kg.errors import PoolBusyError
from kg.workers.call import Call


class Turns:
    """Bounds how many of a pool's `workers` are busy with the past at once."""

    def __init__(self, workers: int) -> None:
        self._past = threading.BoundedSemaphore(max(1, workers - 1))

    @contextmanager
    def turn(self, call: Call, seconds: float) -> Iterator[None]:
        """Begins when the call may take a worker; PoolBusyError where that takes too long."""
        if not call.is_of_past:
            yield
            return
        if not self._past.acquire(timeout=seconds):
            raise PoolBusyError(
                "as many questions about the past are being answered as may be at once; "
                "ask again later"
            )
        try:
            yield
        finally:
            self._past.release()
