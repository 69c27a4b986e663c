"""Change broadcast: passes each commit to the followers of the map.

The committing thread only passes the change set to the event loop. There each follower has a
bounded queue; a follower that is too slow is dropped, so that it does not delay the others.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from typing import Protocol

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import change_to_json
from kg.serving.server.http.event_stream import event
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.settings import Limits


class BroadcastClient(Protocol):
    """Receiver of commits on the event loop; it stops once `ended` is set."""

    ended: asyncio.Event

    def offer(self, change: ChangeSet) -> None:
        """Receive a commit."""


class Queue:
    """Follower with a queue of changes; it ends when more than `room` wait."""

    def __init__(self, room: int) -> None:
        self.ended = asyncio.Event()
        self._room = room
        self._waiting: deque[ChangeSet] = deque()
        self._some = asyncio.Event()

    def offer(self, change: ChangeSet) -> None:
        """Queue a change, or end if the queue is full."""
        if len(self._waiting) >= self._room:
            self._waiting.clear()
            self.ended.set()
        else:
            self._waiting.append(change)
            self._some.set()

    async def take(self) -> ChangeSet:
        """Wait for the next change."""
        while not self._waiting:
            self._some.clear()
            await self._some.wait()
        return self._waiting.popleft()


class ChangeBroadcast:
    """The last changes of a map and its followers; used on one event loop."""

    def __init__(self, semantic_map: SemanticMap, limits: Limits) -> None:
        self._map, self._limits = semantic_map, limits
        self._recent: deque[ChangeSet] = deque(maxlen=limits.feed_memory)
        self._followers: dict[BroadcastClient, str] = {}  # -> client
        self._events: OrderedDict[int, bytes] = OrderedDict()  # the last ones, by sequence number
        self._stop: Callable[[], None] | None = None
        self.commits = 0  # since the server started
        self.dropped = 0  # followers that were too slow

    def start(self) -> None:
        """Subscribe to the map."""
        loop = asyncio.get_running_loop()

        def on_commit(change: ChangeSet) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._deliver, change)

        self._stop = self._map.subscriptions.listen(on_commit)

    def stop(self) -> None:
        """Unsubscribe from the map, and end every follower."""
        if self._stop is not None:
            self._stop()
            self._stop = None
        for follower in self._followers:
            follower.ended.set()

    @property
    def followers(self) -> int:
        """Number of followers."""
        return len(self._followers)

    def add(self, follower: BroadcastClient, client: str) -> None:
        """Pass commits on to a client's `follower`.

        Raises Problem 503 if all clients, or this one, have as many followers as allowed.
        """
        own = sum(other == client for other in self._followers.values())
        if len(self._followers) >= self._limits.feed_clients or own >= self._limits.client_feeds:
            raise Problem(
                503,
                f"this map has {len(self._followers)} followers already, {own} of them yours; "
                "try later",
                {"Retry-After": "10"},
            )
        self._followers[follower] = client

    def remove(self, follower: BroadcastClient) -> None:
        """Remove a follower."""
        self._followers.pop(follower, None)

    def event_of(self, change: ChangeSet) -> bytes:
        """A commit as a server-sent event, encoded once for all followers."""
        if change.sequence not in self._events:
            text = event(change.sequence, "change", change_to_json(change))
            self._events[change.sequence] = text
            if len(self._events) > self._limits.feed_backlog:
                self._events.popitem(last=False)
        return self._events[change.sequence]

    def since(self, sequence: int) -> Iterable[ChangeSet]:
        """Change sets after a sequence number, oldest first, without a gap.

        Raises Problem 410 if they are not kept any more, or if the number is larger than the map's.
        The client must then read the map again.
        """
        now = self._map.sequence
        if sequence > now:
            message = f"this map is at transaction {now}, not at {sequence}; read it again"
            raise Problem(410, message, kind="HistoryError")
        if sequence == now:
            return ()
        recent = [change for change in self._recent if change.sequence > sequence]
        if recent and recent[0].sequence == sequence + 1:
            return recent
        try:
            return self._map.history.changes(sequence)
        except HistoryError as error:
            raise Problem(410, f"{error}; read the map again", kind="HistoryError") from error

    def _deliver(self, change: ChangeSet) -> None:
        self.commits += 1
        self._recent.append(change)
        for follower in tuple(self._followers):
            follower.offer(change)
            if follower.ended.is_set():
                self.dropped += 1
                self._followers.pop(follower, None)
