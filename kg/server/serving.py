"""What the parts of a running server share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from kg.semantic_map import SemanticMap
from kg.server.feed import Feed, Follower
from kg.server.metrics import Metrics
from kg.server.settings import Settings
from kg.server.tally import Tally
from kg.workers.pool import QueryPool

#: What else runs beside the server, for `/health`: name -> how it is.
Status = Callable[[], Mapping[str, object]]


@dataclass(slots=True)
class Serving:
    """One map being served; `written` is the last commit a client was told of."""

    semantic_map: SemanticMap
    settings: Settings
    pool: QueryPool
    feed: Feed
    tally: Tally
    metrics: Metrics = field(default_factory=Metrics)
    standing: set[Follower] = field(default_factory=set)  # the standing queries among followers
    status: Status = dict
    written: int = 0
