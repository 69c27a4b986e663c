"""State of a running server, shared by its endpoints."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol, TypeVar

from starlette.requests import Request

from kg.maps.stored_map import StoredMap
from kg.serving.server.change_broadcast import BroadcastClient, ChangeBroadcast
from kg.serving.server.http.client_sessions import Sessions
from kg.serving.server.http.limits.reading_threads import WRITERS, ReadingThreads
from kg.serving.server.http.settings import Settings
from kg.serving.server.metrics import Metrics
from kg.serving.server.running_counts import RunningCounts
from kg.serving.server.state_cache import StateCache
from kg.serving.workers.pool import QueryPool
from kg.store.write_limit import WriteLimit

T = TypeVar("T")

#: State of programs beside the server, for `/health`: name -> state.
Status = Callable[[], Mapping[str, object]]

#: Makes a search plan as plain values for the names of objects. Raises HereaboutsError.
Planner = Callable[[list[str]], Mapping[str, object]]


class QuerySubscription(BroadcastClient, Protocol):
    """A client's subscription to a query."""

    client: str


@dataclass(slots=True)
class PlanningTurns:
    """Queue of requests for plans; `lock` is locked while a plan is made."""

    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting: int = 0  # requests

    def end(self, plan: asyncio.Future[Mapping[str, object]]) -> None:
        """Let the next request proceed once a plan is made or has failed."""
        self.lock.release()
        if not plan.cancelled():
            plan.exception()  # marks the exception as read: the client may have left


@dataclass(slots=True)
class AppState:
    """State of the server of one map."""

    semantic_map: StoredMap
    settings: Settings
    pool: QueryPool
    feed: ChangeBroadcast
    tally: RunningCounts
    metrics: Metrics = field(default_factory=Metrics)
    subscriptions: set[QuerySubscription] = field(default_factory=set)
    status: Status = dict
    planner: Planner | None = None  # for `/find`
    planning: PlanningTurns = field(default_factory=PlanningTurns)
    states: StateCache = field(default_factory=StateCache)
    surfaces: StateCache = field(default_factory=StateCache)
    sessions: Sessions = field(default_factory=Sessions)
    threads: ReadingThreads = field(default_factory=ReadingThreads)
    writers: ReadingThreads = field(default_factory=partial(ReadingThreads, WRITERS))
    ending: threading.Event = field(default_factory=threading.Event)  # set when the server ends

    async def read(self, request: Request, act: Callable[[], T]) -> T:
        """The result of `act` in a thread, once it is this client's turn.

        Raises PoolBusyError if too many requests of the client wait.
        """
        return await self.threads.run(request.state.client, act)

    async def write(self, request: Request, act: Callable[[], T]) -> T:
        """The result of `act`, a write, in a thread, once it is this client's turn.

        It completes even if the client leaves, within the time limit of queries. Raises
        PoolBusyError if too many requests of the client wait, and as `WriteLimit`.
        """
        limit = WriteLimit(self.settings.limits.query_seconds, self.ending)

        def limited() -> T:
            with limit.in_force():
                return act()

        return await asyncio.shield(self.writers.run(request.state.client, limited))

    def author_of(self, request: Request) -> str:
        """The name of the client that writes; raises Problem as `BearerTokens.holder`."""
        return self.settings.tokens.holder(request.headers.get("authorization"))
