"""State of a running server, shared by its endpoints, with running counts of the map.

Each change set updates the number of objects and the last change of each graph without queries.
After a change of the hierarchy of categories the objects are counted again.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Protocol, TypeVar

from pyoxigraph import BlankNode, NamedNode, Quad, Triple
from starlette.requests import Request

from kg.maps.facts.object_filters import subcategories
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.transactions import ChangeSet
from kg.serving.server.change_broadcast import BroadcastClient, ChangeBroadcast
from kg.serving.server.http.clients import WRITERS, ReadingThreads, Sessions
from kg.serving.server.http.settings import Settings
from kg.serving.server.metrics import Metrics
from kg.serving.workers.admission import FairQueue
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer
from kg.store.write_limit import WriteLimit

_Typed = tuple[NamedNode | BlankNode | Triple, object]  # a thing and a class

_IS_A: Final = NamedNode(v.IS_A)
_OBJECT: Final = NamedNode(v.OBJECT)


class RunningCounts:
    """Counts of one map from construction until `stop`; safe from any thread."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        with semantic_map.hold():
            self._begun = semantic_map.sequence
            self._changed: dict[NamedNode, int] = {}
            self._stale = False
            self._recount()
            self._stop: Callable[[], None] | None = semantic_map.subscriptions.listen(
                self._on_commit
            )

    @property
    def objects(self) -> int:
        """Number of things with a category of objects."""
        if self._stale:
            with self._map.hold():
                self._recount()
                self._stale = False
        return self._objects

    def changed(self, graph: NamedNode) -> int:
        """The last transaction that changed a graph, or the first one that was counted."""
        return self._changed.get(graph, self._begun)

    def stop(self) -> None:
        """Unsubscribe from the map."""
        if self._stop is not None:
            self._stop()
            self._stop = None

    def _on_commit(self, change: ChangeSet) -> None:
        quads = (*change.added, *change.removed)
        for graph in {quad.graph_name for quad in quads}:
            if isinstance(graph, NamedNode):
                self._changed[graph] = change.sequence
        if any(quad.predicate in (v.RDF_TYPE, _IS_A) for quad in quads):
            self._changed[v.INFERRED_GRAPH] = change.sequence
        kinds = {q.subject for q in quads if q.predicate == _IS_A and q.object == _OBJECT}
        if kinds:
            # the categories of objects have changed
            self._stale = True
        else:
            self._objects += self._more(change)

    def _more(self, change: ChangeSet) -> int:
        """The change of the number of objects by a change set that leaves categories unchanged."""
        added, removed = _types(change.added), _types(change.removed)
        more = 0
        for subject in {s for s, _ in added | removed}:
            held = self._map.engine.quads_for_pattern(subject, v.RDF_TYPE, None, v.MAP_GRAPH)
            now = {(subject, quad.object) for quad in held}
            more += self._counts(now) - self._counts((now | removed) - added, subject)
        return more

    def _counts(self, types: Iterable[_Typed], about: object = None) -> bool:
        return any(
            kind in self._kinds and (about is None or subject == about) for subject, kind in types
        )

    def _recount(self) -> None:
        engine = self._map.engine
        self._kinds = frozenset(map(NamedNode, subcategories(engine, v.OBJECT)))
        self._objects = len(
            {
                quad.subject
                for kind in self._kinds
                for quad in engine.quads_for_pattern(None, v.RDF_TYPE, kind, v.MAP_GRAPH)
            }
        )


def _types(quads: Iterable[Quad]) -> set[_Typed]:
    return {
        (q.subject, q.object)
        for q in quads
        if q.predicate == v.RDF_TYPE and q.graph_name == v.MAP_GRAPH
    }


T = TypeVar("T")
MAX_BYTES: Final = 32 << 20  # of all answers in the cache; the last one is always kept
MAX_WAITING: Final = 16  # requests of one client for answers of one kind

#: State of programs beside the server, for `/health`: name -> state.
Status = Callable[[], Mapping[str, object]]

#: Makes a search plan as plain values for the names of objects. Raises HereaboutsError.
Planner = Callable[[list[str]], Mapping[str, object]]


class QuerySubscription(BroadcastClient, Protocol):
    """A client's subscription to a query."""

    client: str


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
    tally: RunningCounts
    metrics: Metrics = field(default_factory=Metrics)
    subscriptions: set[QuerySubscription] = field(default_factory=set)
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
