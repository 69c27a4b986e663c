"""What the parts of a running server share."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from kg.maps.semantic_map import SemanticMap
from kg.server.change_broadcast import BroadcastClient, ChangeBroadcast
from kg.server.http.client_sessions import Sessions
from kg.server.http.settings import Settings
from kg.server.metrics import Metrics
from kg.server.running_counts import RunningCounts
from kg.workers.pool import QueryPool

#: What else runs beside the server, for `/health`: name -> how it is.
Status = Callable[[], Mapping[str, object]]

#: A search plan for objects, as plain values: what is wanted -> the plan. Raises HereaboutsError.
Planner = Callable[[list[str]], Mapping[str, object]]


class QuerySubscription(BroadcastClient, Protocol):
    """A query that a client follows."""

    client: str


@dataclass(slots=True)
class PlanningTurns:
    """Whose turn it is to have a plan made; `lock` is held while one is made."""

    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting: int = 0  # requests

    def end(self, plan: asyncio.Future[Mapping[str, object]]) -> None:
        """A plan is made, or failed: the next one's turn."""
        self.lock.release()
        if not plan.cancelled():
            plan.exception()  # read, as whoever asked may have left


@dataclass(slots=True)
class AppState:
    """One map being served."""

    semantic_map: SemanticMap
    settings: Settings
    pool: QueryPool
    feed: ChangeBroadcast
    tally: RunningCounts
    metrics: Metrics = field(default_factory=Metrics)
    subscriptions: set[QuerySubscription] = field(default_factory=set)
    status: Status = dict
    planner: Planner | None = None  # for `/find`
    planning: PlanningTurns = field(default_factory=PlanningTurns)
    sessions: Sessions = field(default_factory=Sessions)
