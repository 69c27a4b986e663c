"""Resources that agents subscribe to: "tell me when a cup appears".

A client reads ``hereabouts://things/cup`` and listens to it; each commit that changes the objects
of the category, their position or their existence is announced, and the client reads again. One
thing (``hereabouts://things/cup%202``) is announced when it moves or goes. The changes are those of
`SemanticMap.subscriptions`.
"""

from __future__ import annotations

import asyncio
import threading
import time
import weakref
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final
from urllib.parse import unquote

from mcp import MCPError
from mcp.server.connection import Connection
from mcp.server.context import CallNext, ServerRequestContext
from mcp.server.mcpserver.exceptions import ResourceNotFoundError
from mcp.server.subscriptions import InMemorySubscriptionBus, ResourceUpdated
from mcp_types import INVALID_PARAMS, EmptyResult

from hereabouts.agents import answers as a
from hereabouts.agents.lean_tool import document_of, text_of
from hereabouts.agents.map_context import MapContext, state_of
from hereabouts.agents.map_tools import known_thing, one_thing
from hereabouts.agents.plain_values import in_one_line
from kg.model.errors import HereaboutsError
from planner.search.goals.known_objects import known_objects
from planner.search.goals.place_names import object_named
from planner.search.goals.targets import resolve

MAX_WATCHED: Final = 32  # resources; each is a query that is evaluated after every commit
_PREFIX: Final = "hereabouts://things/"


class Watching:
    """The resources of one map, and the announcements of their changes."""

    TEMPLATE: Final = _PREFIX + "{what}"

    def __init__(self, context: MapContext) -> None:
        self._context = context
        self.bus = InMemorySubscriptionBus()
        self._lock = threading.Lock()
        self._listeners = Counter[str]()  # by URI
        self._stops: dict[str, list[Callable[[], None]]] = {}
        self._connections = dict[str, weakref.WeakSet[Connection]]()  # by URI, those subscribed
        self._ends: dict[tuple[str, int], weakref.finalize[..., Connection]] = {}

    def things(self, what: str) -> str:
        """Objects of a category or need (cup, "something to sit on"), the surest first, or one
        thing (object/17, cup 17).

        Listen to it to be told when one appears, moves or goes.
        """
        try:
            known = self._known(what)
        except HereaboutsError as error:
            raise ResourceNotFoundError(_line(error)) from error
        state = state_of(self._context.semantic_map)
        answer = a.WhereIs(map=state, things=known[:20], total=len(known))
        return text_of(document_of(answer, self._context.semantic_map.base))

    def _known(self, what: str) -> list[a.LocatedThing]:
        semantic_map = self._context.semantic_map
        if not (iri := object_named(semantic_map, what)):
            (target,) = resolve(semantic_map, (what,))
            return [known_thing(one, time.time()) for one in known_objects(semantic_map, target)]
        gone = not semantic_map.perceived.objects((iri,))
        return [] if gone else [one_thing(semantic_map, iri, time.time())]

    async def __call__(self, ctx: ServerRequestContext[Any, Any], call_next: CallNext) -> Any:
        """Middleware: watches what a client listens to, as long as it listens."""
        if ctx.method != "subscriptions/listen":
            return await call_next(ctx)
        wanted = (ctx.params or {}).get("notifications") or {}
        loop, watched = asyncio.get_running_loop(), list[str]()
        try:
            for uri in map(str, wanted.get("resourceSubscriptions") or ()):
                await asyncio.to_thread(self._watch, uri, loop)
                watched.append(uri)
            return await call_next(ctx)
        finally:
            # on a thread, since a subscription that ends waits for its callback
            loop.run_in_executor(None, self._release, watched)

    async def subscribe(self, ctx: ServerRequestContext[Any, Any], params: Any) -> EmptyResult:
        """Watch a resource for a client of a protocol before `listen`, as long as it is there."""
        uri, connection = str(params.uri), ctx.session._connection
        end = self._ends.get((uri, id(connection)))
        if end is None or not end.alive:
            end = weakref.finalize(connection, self._release_later, uri, id(connection))
            self._ends[uri, id(connection)] = end
            try:
                await asyncio.to_thread(self._watch, uri, asyncio.get_running_loop())
            except MCPError:
                end.detach()
                del self._ends[uri, id(connection)]
                raise
            self._connections.setdefault(uri, weakref.WeakSet()).add(connection)
        return EmptyResult()

    async def unsubscribe(self, ctx: ServerRequestContext[Any, Any], params: Any) -> EmptyResult:
        """End what `subscribe` began; nothing where it did not."""
        uri, connection = str(params.uri), ctx.session._connection
        self._connections.get(uri, weakref.WeakSet()).discard(connection)
        if end := self._ends.pop((uri, id(connection)), None):
            end()
        return EmptyResult()

    async def _publish(self, uri: str) -> None:
        await self.bus.publish(ResourceUpdated(uri))
        for connection in tuple(self._connections.get(uri, ())):
            await connection.send_resource_updated(uri)

    def _release_later(self, uri: str, connection: int) -> None:
        self._ends.pop((uri, connection), None)
        if not self._connections.get(uri):
            self._connections.pop(uri, None)
        threading.Thread(target=self._release, args=([uri],), daemon=True).start()

    def _watch(self, uri: str, loop: asyncio.AbstractEventLoop) -> None:
        with self._lock:
            self._listeners[uri] += 1
            if uri in self._stops:
                return
            try:
                self._stops[uri] = self._begin(uri, loop)
            except MCPError:
                self._listeners[uri] -= 1
                raise

    def _begin(self, uri: str, loop: asyncio.AbstractEventLoop) -> list[Callable[[], None]]:
        if len(self._stops) >= MAX_WATCHED:
            raise MCPError(INVALID_PARAMS, f"clients listen to {MAX_WATCHED} resources, the most")
        if not uri.startswith(_PREFIX):
            raise MCPError(INVALID_PARAMS, f"no resource {uri!r}; there is {self.TEMPLATE}")
        semantic_map = self._context.semantic_map
        what = unquote(uri.removeprefix(_PREFIX))
        try:
            iri = object_named(semantic_map, what)
            queried = () if iri else resolve(semantic_map, (what,))[0].queried
        except HereaboutsError as error:
            raise MCPError(INVALID_PARAMS, _line(error)) from error

        def announce(added: object, removed: object) -> None:
            asyncio.run_coroutine_threadsafe(self._publish(uri), loop)

        on = semantic_map.subscriptions.on
        if iri:
            return [on("whereabouts", announce, object=iri)]
        return [on("objects-by-category", announce, category=category) for category in queried]

    def _release(self, uris: Sequence[str]) -> None:
        with self._lock:
            self._listeners.subtract(uris)
            ended = [uri for uri in set(uris) if not self._listeners[uri]]
            stops = [stop for uri in ended for stop in self._stops.pop(uri, ())]
        for stop in stops:
            stop()


def _line(error: HereaboutsError) -> str:
    return in_one_line(str(error))
