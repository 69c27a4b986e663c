"""The server of one map, and its application: the table of paths and endpoints."""

from __future__ import annotations

import contextlib
import logging
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any, cast

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import HereaboutsError, ServerError
from kg.serving.server.app_state import AppState, GraphChanges, Planner, Status, objects_in
from kg.serving.server.change_broadcast import ChangeBroadcast
from kg.serving.server.endpoints.feed_endpoints import changes, subscribe
from kg.serving.server.endpoints.graph_store_protocol import dump, graph_store
from kg.serving.server.endpoints.read_endpoints import (
    diff,
    find,
    log,
    page_file,
    picture,
    question,
    questions,
    state,
    surface,
    timeline,
    why,
)
from kg.serving.server.endpoints.sparql_protocol import sparql
from kg.serving.server.endpoints.write_endpoints import (
    assertions,
    labels,
    numbers,
    records,
    restore,
    rooms,
)
from kg.serving.server.http.bodies import json_response
from kg.serving.server.http.lifecycle import ServerLifecycle
from kg.serving.server.http.middleware import RequestGuard
from kg.serving.server.http.problems import Problem, problem_of, problem_response, without_paths
from kg.serving.server.http.settings import Settings
from kg.serving.server.linked_data.descriptions import dataset_description
from kg.serving.server.linked_data.memento import timegate, timemap
from kg.serving.server.linked_data.pages import (
    console_page,
    resource,
    root_page,
    skolem,
    thing_at_path,
)
from kg.serving.server.metrics import MEDIA_TYPE, Reading
from kg.serving.workers.isolation import Confinement
from kg.serving.workers.pool import QueryPool

_log = logging.getLogger("hereabouts.server")

MIN_COMPRESSED = 1024  # [bytes] of an answer

Answer = Callable[[AppState, Request], Awaitable[ASGIApp]]


def application(serving: AppState) -> ASGIApp:
    """The ASGI application of a server: its routes behind the request guard."""
    serving.metrics.readings += _readings(serving)
    get, write = ["GET"], ["GET", "POST", "PUT", "DELETE"]
    table: list[tuple[str, Answer, list[str]]] = [
        ("/", root_page, get),
        ("/console", console_page, get),
        ("/queries", questions, get),
        ("/queries/{name:str}", question, get),
        ("/sparql", sparql, ["GET", "POST"]),
        ("/sparql/", sparql, ["GET", "POST"]),
        ("/graphs", graph_store, write),
        ("/graphs/{name:path}", graph_store, write),
        ("/dump.{ending:str}", dump, get),
        ("/.well-known/void", dataset_description, get),
        ("/.well-known/genid/{name:path}", skolem, get),
        ("/assertions", assertions, ["GET", "POST", "DELETE"]),
        ("/rooms", rooms, ["POST"]),
        ("/records", records, ["POST"]),
        ("/numbers", numbers, ["POST"]),
        ("/labels", labels, ["POST"]),
        ("/restore", restore, ["POST"]),
        ("/log", log, get),
        ("/diff", diff, get),
        ("/why", why, get),
        ("/timeline", timeline, get),
        ("/state", state, get),
        ("/timemap", timemap, get),
        ("/timegate/{address:path}", timegate, get),
        ("/find", find, get),
        ("/pictures/{number:str}", picture, get),
        ("/surface", surface, get),
        ("/changes", changes, get),
        ("/subscribe", subscribe, get),
        ("/health", _health, get),
        ("/metrics", _metrics, get),
        ("/files/{name:path}", page_file, get),
        ("/resource", resource, get),
        ("/{path:path}", thing_at_path, get),
    ]
    routes = [Route(path, _Endpoint(serving, answer), methods=how) for path, answer, how in table]

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        serving.feed.start()
        yield
        serving.feed.stop()

    app = Starlette(
        routes=routes, lifespan=lifespan, exception_handlers={HTTPException: routing_error}
    )
    app.router.redirect_slashes = False
    compressed = GZipMiddleware(app, minimum_size=MIN_COMPRESSED, compresslevel=6)
    guarded = RequestGuard(compressed, serving.settings, serving.metrics)
    proxies = list(serving.settings.trusted_proxies)
    return (
        cast(ASGIApp, ProxyHeadersMiddleware(cast(Any, guarded), proxies)) if proxies else guarded
    )


class _Endpoint:
    """Endpoint of one path; errors of `kg.model.errors` become problem responses."""

    def __init__(self, serving: AppState, answer: Answer) -> None:
        self._serving, self._answer = serving, answer
        path = serving.semantic_map.store.path
        given = [] if path is None else [path, path.resolve(), path.resolve().parent]
        folders = (*given, Path(tempfile.gettempdir()))
        self._folders = [folder for folder in folders if len(folder.parts) > 1]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        try:
            answer = await self._answer(self._serving, request)
        except HereaboutsError as error:
            problem = problem_of(error)
            if problem.status >= 500:
                _log.warning("%s: %s", scope["path"][:200], error)
            problem = without_paths(problem, self._folders)
            answer = problem_response(problem, request.headers.get("accept"))
        await answer(scope, receive, send)


async def _health(serving: AppState, request: Request) -> Response:
    semantic_map = serving.semantic_map
    authorization = request.headers.get("authorization")
    author = serving.settings.tokens.find(authorization)
    content = {
        "status": "ok",
        "map": semantic_map.description.title,
        "base": semantic_map.base,
        "sequence": semantic_map.sequence,
        **serving.status(),
        **({} if authorization is None else {"author": author}),
    }
    return json_response(content)


async def _metrics(serving: AppState, request: Request) -> Response:
    text = await run_in_threadpool(serving.metrics.text)
    return Response(text, headers={"Content-Type": MEDIA_TYPE})


async def routing_error(request: Request, error: Exception) -> Response:
    """Error response for an unknown path, or for a method that the path does not have."""
    assert isinstance(error, HTTPException)
    if error.status_code == 405:
        message = f"{request.url.path[:200]} does not allow {request.method}"
    else:
        message = f"nothing is at {request.url.path[:200]}"
    problem = Problem(error.status_code, message, error.headers)
    return problem_response(problem, request.headers.get("accept"))


def _readings(serving: AppState) -> list[Reading]:
    feed, pool = serving.feed, serving.pool
    return [
        ("hereabouts_sequence", "Last commit.", lambda: serving.semantic_map.sequence),
        ("hereabouts_commits_total", "Commits since the start.", lambda: feed.commits),
        ("hereabouts_query_workers", "Worker processes.", lambda: len(pool.pids)),
        ("hereabouts_query_workers_busy", "Worker processes with a query.", lambda: pool.busy),
        (
            "hereabouts_objects",
            "Objects in the map.",
            lambda: objects_in(serving.semantic_map.engine),
        ),
        ("hereabouts_feed_clients", "Followers of changes and queries.", lambda: feed.followers),
        ("hereabouts_feed_dropped_total", "Followers that were too slow.", lambda: feed.dropped),
        ("hereabouts_standing_queries", "Followed queries.", lambda: len(serving.subscriptions)),
    ]


class MapServer(ServerLifecycle):
    """Serves one map; `run` blocks, a context manager serves from a thread.

    The caller may write the map meanwhile, and closes it. The constructor raises ServerError if it
    cannot listen at the address.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: Settings | None = None,
        *,
        status: Status = dict,
        planner: Planner | None = None,
    ) -> None:
        if not isinstance(semantic_map, StoredMap):
            raise ServerError("the map is served already: use the address of its server")
        super().__init__(settings)
        limits = self.settings.limits
        self.serving = AppState(
            semantic_map,
            self.settings,
            QueryPool(
                semantic_map,
                workers=limits.workers,
                timeout=limits.query_seconds,
                memory_mb=limits.query_memory,
                max_result_bytes=limits.result,
                refresh=limits.staleness,
                services=self.settings.services,
            ),
            ChangeBroadcast(semantic_map, limits),
            GraphChanges(semantic_map),
            status=status,
            planner=planner,
        )
        self._answer_with(application(self.serving), self._end_requests)

    @property
    def confinement(self) -> Confinement:
        """Confinement by the kernel of the processes that evaluate queries."""
        return self.serving.pool.confinement

    def _end_requests(self) -> None:
        """End what would run on: feeds, and writes that are not committed yet."""
        self.serving.feed.stop()
        self.serving.ending.set()

    def _close(self) -> None:
        self.serving.ending.set()
        self.serving.changed.stop()
        self.serving.pool.close()
        super()._close()
