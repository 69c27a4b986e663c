"""State of a running server, shared by its endpoints: answers of moments, changes of graphs."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, TypeVar

from pyoxigraph import NamedNode
from starlette.requests import Request

from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.transactions import ChangeSet
from kg.rdf.quad_store import QuadStore
from kg.serving.server.change_broadcast import ChangeBroadcast
from kg.serving.server.http.clients import WRITERS, ReadingThreads, Sessions
from kg.serving.server.http.settings import Settings
from kg.serving.server.metrics import Metrics
from kg.serving.workers.admission import FairQueue
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer
from kg.store.scheduling import WriteLimit

_IS_A: Final = NamedNode(v.IS_A)
_OBJECT: Final = NamedNode(v.OBJECT)


class GraphChanges:
    """The last change of each graph from construction until `stop`; safe from any thread."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        with semantic_map.hold():
            self._begun = semantic_map.sequence
            self._changed: dict[NamedNode, int] = {}
            self._stop = semantic_map.subscriptions.listen(self._on_commit)

    def last(self, graph: NamedNode) -> int:
        """The last transaction that changed a graph, or the first one that was seen."""
        return self._changed.get(graph, self._begun)

    def stop(self) -> None:
        """Unsubscribe from the map; a second call does nothing."""
        stop, self._stop = self._stop, lambda: None
        stop()

    def _on_commit(self, change: ChangeSet) -> None:
        quads = (*change.added, *change.removed)
        for graph in {quad.graph_name for quad in quads}:
            if isinstance(graph, NamedNode):
                self._changed[graph] = change.sequence
        if any(quad.predicate in (v.RDF_TYPE, _IS_A) for quad in quads):
            self._changed[v.INFERRED_GRAPH] = change.sequence


def objects_in(engine: QuadStore) -> int:
    """Number of things with a category of objects, of which each superclass is a fact."""
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, _OBJECT, None)
    return len({quad.subject for quad in quads})


T = TypeVar("T")
MAX_BYTES: Final = 32 << 20  # of all answers in the cache; the last one is always kept
MAX_WAITING: Final = 16  # requests of one client for answers of one kind

#: State of programs beside the server, for `/health`: name -> state.
Status = Callable[[], Mapping[str, object]]

#: Makes a search plan as plain values for the names of objects. Raises HereaboutsError.
Planner = Callable[[list[str]], Mapping[str, object]]


class MomentCache:
    """The last answers about moments, each made once for all clients; used on one event loop.

    One of each kind (the first part of its key) is made at a time, and clients take turns. A
    request whose client has left gives up its turn, so that somebody who drags through a year costs
    one answer at a time, and only of moments that are still asked for.
    """

    def __init__(self) -> None:
        self.answers: OrderedDict[tuple[object, ...], Answer] = OrderedDict()
        self.mark = secrets.token_hex(4)  # of this server, in entity tags
        self._queues: dict[object, FairQueue] = {}

    async def get(
        self, key: tuple[object, ...], client: str, make: Callable[[], Awaitable[Answer]]
    ) -> Answer:
        """The answer of that key; `make` makes it if it is not in the cache.

        It is completed even if the request is cancelled meanwhile. Raises PoolBusyError if too many
        requests of this client wait, and as `make`.
        """
        if key in self.answers:
            self.answers.move_to_end(key)
            return self.answers[key]
        queue = self._queues.setdefault(key[0], FairQueue(1, MAX_WAITING))
        turn = queue.enter(client, "present")
        try:
            await asyncio.wrap_future(turn.granted)
            making = asyncio.ensure_future(self._made(key, make))
        except BaseException:
            queue.leave(turn)
            raise

        def end(made: asyncio.Future[Answer]) -> None:
            queue.leave(turn)
            if not made.cancelled():
                made.exception()  # marks the exception as read: the client may have left

        making.add_done_callback(end)
        return await asyncio.shield(making)

    async def _made(self, key: tuple[object, ...], make: Callable[[], Awaitable[Answer]]) -> Answer:
        if key not in self.answers:  # another request may have made it meanwhile
            self.answers[key] = await make()
            while len(self.answers) > 1 and self._size() > MAX_BYTES:
                self.answers.popitem(last=False)
        return self.answers[key]

    def _size(self) -> int:
        return sum(len(one.body) for one in self.answers.values())


@dataclass(slots=True)
class AppState:
    """State of the server of one map."""

    semantic_map: StoredMap
    settings: Settings
    pool: QueryPool
    feed: ChangeBroadcast
    changed: GraphChanges
    metrics: Metrics = field(default_factory=Metrics)
    subscriptions: list[str] = field(default_factory=list)  # the client of each followed query
    status: Status = dict
    planner: Planner | None = None  # for `/find`
    moments: MomentCache = field(default_factory=MomentCache)
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
