"""Commits as they happen, handed to everyone who follows the map.

The committing thread only hands a change set over to the event loop. Each follower has a bounded
queue there: one that does not keep up is dropped, so that it costs the others nothing.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from typing import Protocol

from kg.client.record_codec import change_to_json
from kg.errors import HistoryError
from kg.maps.semantic_map import SemanticMap
from kg.server.http.event_stream import event
from kg.server.http.problems import Problem
from kg.server.http.settings import Limits
from kg.transactions import ChangeSet


class BroadcastClient(Protocol):
    """Receiver of commits on the event loop; `ended` is set once it must stop."""

    ended: asyncio.Event

    def offer(self, change: ChangeSet) -> None:
        """Take note of a commit."""


class Queue:
    """A follower that wants every change; ends when more than `room` wait for it."""

    def __init__(self, room: int) -> None:
        self.ended = asyncio.Event()
        self.slow = False
        self._room = room
        self._waiting: deque[ChangeSet] = deque()
        self._some = asyncio.Event()

    def offer(self, change: ChangeSet) -> None:
        """Queue a change, or end where there is no room for it."""
        if len(self._waiting) >= self._room:
            self.slow = True
            self._waiting.clear()
            self.ended.set()
        else:
            self._waiting.append(change)
            self._some.set()

    async def take(self) -> ChangeSet:
        """The next change; waits for one."""
        while not self._waiting:
            self._some.clear()
            await self._some.wait()
        return self._waiting.popleft()


class ChangeBroadcast:
    """The last changes of a map, and its followers. All but `start` runs on one event loop."""

    def __init__(self, semantic_map: SemanticMap, limits: Limits) -> None:
        self._map, self._limits = semantic_map, limits
        self._recent: deque[ChangeSet] = deque(maxlen=limits.feed_memory)
        self._followers: dict[BroadcastClient, str] = {}  # and the client of each
        self._events: OrderedDict[int, bytes] = OrderedDict()  # by sequence, the last ones
        self._stop: Callable[[], None] | None = None
        self.commits = 0  # since the server started
        self.dropped = 0  # followers that were too slow

    def start(self) -> None:
        """Listen to the map from now on; called on the event loop."""
        loop = asyncio.get_running_loop()

        def hear(change: ChangeSet) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._deliver, change)

        self._stop = self._map.listen(hear)

    def stop(self) -> None:
        """Listen no more, and end every follower."""
        if self._stop is not None:
            self._stop()
            self._stop = None
        for follower in self._followers:
            follower.ended.set()

    @property
    def followers(self) -> int:
        """How many follow now."""
        return len(self._followers)

    def add(self, follower: BroadcastClient, client: str) -> None:
        """Have a client's `follower` hear of commits.

        Raises Problem 503 where there are too many already, of all clients or of this one.
        """
        own = sum(other == client for other in self._followers.values())
        if len(self._followers) >= self._limits.feed_clients or own >= self._limits.client_feeds:
            raise Problem(
                503,
                f"{len(self._followers)} feeds of this map are followed already, {own} of them by "
                "you; try later",
                {"Retry-After": "10"},
            )
        self._followers[follower] = client

    def remove(self, follower: BroadcastClient) -> None:
        """Forget a follower."""
        self._followers.pop(follower, None)

    def event_of(self, change: ChangeSet) -> bytes:
        """A commit as a server-sent event, encoded once for all who follow."""
        if change.sequence not in self._events:
            text = event(change.sequence, "change", change_to_json(change))
            self._events[change.sequence] = text
            if len(self._events) > self._limits.feed_backlog:
                self._events.popitem(last=False)
        return self._events[change.sequence]

    def since(self, sequence: int) -> Iterable[ChangeSet]:
        """Change sets after that number, oldest first, without a gap.

        Raises Problem 410 where they are not known any more, or the map has not got so far (so the
        number comes from another map): the client has to read the map anew.
        """
        now = self._map.sequence
        if sequence > now:
            message = f"this map is at {now}, not at {sequence}; read it anew"
            raise Problem(410, message, kind="HistoryError")
        if sequence == now:
            return ()
        recent = [change for change in self._recent if change.sequence > sequence]
        if recent and recent[0].sequence == sequence + 1:
            return recent
        try:
            return self._map.changes(sequence)
        except HistoryError as error:
            raise Problem(410, f"{error}; read the map anew", kind="HistoryError") from error

    def _deliver(self, change: ChangeSet) -> None:
        self.commits += 1
        self._recent.append(change)
        for follower in tuple(self._followers):
            follower.offer(change)
            if follower.ended.is_set():
                self.dropped += 1
                self._followers.pop(follower, None)
