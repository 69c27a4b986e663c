"""Threads for requests that read the map in the server's own process; clients take turns."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, TypeVar

from starlette.concurrency import run_in_threadpool

from kg.serving.workers.admission import FairQueue

T = TypeVar("T")
THREADS: Final = 2  # that read at once; they share the interpreter's lock with the event loop
WRITERS: Final = 4  # writes at once: they are validated beside each other
WAITING: Final = 32  # requests of one client


class ReadingThreads:
    """Threads; the last free one is for a client without a running request."""

    def __init__(self, threads: int = THREADS) -> None:
        self._queue = FairQueue(threads, WAITING)

    async def run(self, client: str, act: Callable[[], T]) -> T:
        """The result of `act`; raises PoolBusyError if too many requests of this client wait."""
        turn = self._queue.enter(client, "present")
        try:
            await asyncio.wrap_future(turn.granted)
            return await run_in_threadpool(act)
        finally:
            self._queue.leave(turn)
