"""Whose turn it is: questions about the past leave a worker free for those about the present.

A state of the past may take seconds to be made, and a history long to be told. However many ask for
that, who asks how it is now finds a worker; a pool of one worker has only one line.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Final

from kg.errors import PoolBusyError
from kg.workers.call import Call

_BUSY: Final = (
    "as many questions about the past are being answered as may be at once; ask again later"
)


class Turns:
    """Bounds how many of a pool's `workers`, and of its `queue`, are taken by the past at once."""

    def __init__(self, workers: int, queue: int) -> None:
        most = max(1, workers - 1)
        self._past = threading.BoundedSemaphore(most)
        self._places = threading.BoundedSemaphore(most + queue // 2)

    def place(self, call: Call) -> AbstractContextManager[None]:
        """Begins when the call may wait for its turn; PoolBusyError where too many do."""
        return _held(self._places, 0.0) if call.is_of_past else nullcontext()

    def turn(self, call: Call, seconds: float) -> AbstractContextManager[None]:
        """Begins when the call may take a worker; PoolBusyError where that takes too long."""
        return _held(self._past, seconds) if call.is_of_past else nullcontext()


@contextmanager
def _held(bound: threading.BoundedSemaphore, seconds: float) -> Iterator[None]:
    if not bound.acquire(timeout=seconds):
        raise PoolBusyError(_BUSY)
    try:
        yield
    finally:
        bound.release()
