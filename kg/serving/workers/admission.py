"""Fair queueing (Nagle, RFC 970): clients take turns for the workers of a pool.

Each client has a short queue of its own, so that a client with too many queries delays only
itself. The last free worker is reserved for clients without a running query, for queries about the
present. So a client with few requests finds a worker, however many requests another client sends.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Final, Literal

from kg.model.errors import GraphError, PoolBusyError

#: queries about the present, about the past (which may take seconds), and of subscriptions
Lane = Literal["present", "past", "standing"]

SHARES: Final = 8  # number of full queues; with more clients each queue is shorter
OVERDUE: Final = 5.0  # [s] of waiting after which a subscription's query has normal priority


@dataclass(eq=False, slots=True)
class Turn:
    """Place of a query in the queue; `granted` is done once it may use a worker."""

    client: str
    lane: Lane
    granted: Future[None] = field(default_factory=Future)
    since: float = field(default_factory=time.monotonic)


class FairQueue:
    """Grants up to `workers` turns at once; a client may have `queue` turns waiting.

    Up to half of the waiting turns may be about the past. Safe from any thread.
    """

    def __init__(self, workers: int, queue: int) -> None:
        self._workers, self._queue = workers, queue
        self._guard = threading.Lock()
        self._waiting: OrderedDict[str, list[Turn]] = (
            OrderedDict()
        )  # ordered by the time of the last turn
        self._running: set[Turn] = set()
        self._closed = False

    @contextmanager
    def turn(self, client: str, lane: Lane, seconds: float) -> Iterator[None]:
        """A turn for a block, awaited for up to `seconds`; raises as `enter`, and PoolBusyError."""
        turn = self.enter(client, lane)
        try:
            with _busy_if_late():
                turn.granted.result(seconds)
            yield
        finally:
            self.leave(turn)

    @asynccontextmanager
    async def turn_async(
        self, client: str, lane: Lane = "present", seconds: float | None = None
    ) -> AsyncIterator[None]:
        """`turn` on an event loop, without `seconds` awaited however long."""
        turn = self.enter(client, lane)
        try:
            if not turn.granted.done():
                with _busy_if_late():
                    await asyncio.wait_for(asyncio.wrap_future(turn.granted), seconds)
            turn.granted.result()
            yield
        finally:
            self.leave(turn)

    def enter(self, client: str, lane: Lane) -> Turn:
        """A turn, granted now or later; the caller ends it with `leave`.

        Raises PoolBusyError if too many of this client wait, GraphError once closed.
        """
        with self._guard:
            if self._closed:
                raise closed()
            turn = Turn(client, lane)
            if self._is_eligible(turn) and not self._waiting.get(client):
                self._grant(turn)
                return turn
            self._check_share(turn)
            self._waiting.setdefault(client, []).append(turn)
            self._grant_next()
            return turn

    def leave(self, turn: Turn) -> None:
        """End a turn, granted or waiting."""
        with self._guard:
            self._running.discard(turn)
            self._remove(turn)
            self._grant_next()

    def close(self) -> None:
        """End all waiting turns with GraphError."""
        with self._guard:
            self._closed = True
            for turn in [t for turns in self._waiting.values() for t in turns]:
                self._remove(turn)
                if turn.granted.set_running_or_notify_cancel():
                    turn.granted.set_exception(closed())

    def _check_share(self, turn: Turn) -> None:
        own = self._waiting.get(turn.client, [])
        clients = len(self._waiting) + (not own)
        allowed = min(self._queue, max(1, SHARES * self._queue // clients))
        if len(own) >= allowed:
            raise PoolBusyError(f"{len(own)} queries of yours wait already; try again later")
        past = sum(other.lane == "past" for other in own)
        if turn.lane == "past" and past >= allowed // 2:
            raise PoolBusyError(
                f"{past} queries of yours about the past wait already; try again later"
            )

    def _grant_next(self) -> None:
        while (turn := self._next()) is not None:
            self._remove(turn)
            self._grant(turn)

    def _next(self) -> Turn | None:
        """The next turn: subscriptions last, then by the fewest running turns of the client."""
        running = Counter(turn.client for turn in self._running)
        found = list(self._first_of_each())
        # `min` keeps the first of equals: the client that was served longest ago
        return min(found, key=lambda t: (_is_behind(t), running[t.client]), default=None)

    def _first_of_each(self) -> Iterator[Turn]:
        for turns in self._waiting.values():
            first = next(filter(self._is_eligible, turns), None)
            if first is not None:
                yield first

    def _is_eligible(self, turn: Turn) -> bool:
        free = self._workers - len(self._running)
        lanes = Counter(other.lane for other in self._running)
        allowed = {"present": self._workers, "past": max(1, self._workers - 2), "standing": 1}
        if free <= 0 or lanes[turn.lane] >= allowed[turn.lane]:
            return False
        return free > 1 or self._workers == 1 or self._is_newcomer(turn)

    def _is_newcomer(self, turn: Turn) -> bool:
        same = (other for other in self._running if other.client == turn.client)
        return turn.lane == "present" and all(other.lane != "present" for other in same)

    def _grant(self, turn: Turn) -> None:
        if turn.granted.set_running_or_notify_cancel():
            self._running.add(turn)
            turn.granted.set_result(None)

    def _remove(self, turn: Turn) -> None:
        own = self._waiting.get(turn.client, [])
        if turn in own:
            own.remove(turn)
            self._waiting.move_to_end(turn.client)
            if not own:
                del self._waiting[turn.client]


def _is_behind(turn: Turn) -> bool:
    return turn.lane == "standing" and time.monotonic() - turn.since < OVERDUE


def closed() -> GraphError:
    """The error of a request to a pool that is closed."""
    return GraphError("the query pool is closed; make a new one")


@contextmanager
def _busy_if_late() -> Iterator[None]:
    try:
        yield
    except TimeoutError as error:
        raise PoolBusyError("all query workers are busy; try again later") from error
