"""The application: which path is answered by what."""

from __future__ import annotations

import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from importlib.resources import files
from typing import Final

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from kg.errors import HereaboutsError
from kg.server import metrics
from kg.server.assertions import assertions
from kg.server.changes import changes
from kg.server.description import dataset_description
from kg.server.front import Front
from kg.server.graphs import dump, graph_store
from kg.server.guard import Guard
from kg.server.memento import timemap
from kg.server.past import diff, log, why
from kg.server.problems import Problem, problem_of, problem_response
from kg.server.protocol import sparql
from kg.server.records import labels, numbers, records
from kg.server.serving import Serving
from kg.server.standing import subscribe
from kg.server.things import resource, thing_at_path

Answer = Callable[[Serving, Request], Awaitable[ASGIApp]]

_FILES: Final = {
    "style.css": "text/css",
    "front.js": "text/javascript",
    "icon.svg": "image/svg+xml",
}


def application(serving: Serving) -> ASGIApp:
    """Everything a server answers, behind its guard."""
    _measure(serving)
    get, write = ["GET"], ["GET", "POST", "PUT", "DELETE"]
    table: list[tuple[str, Answer, list[str]]] = [
        ("/", Front().answer, get),
        ("/sparql", sparql, ["GET", "POST"]),
        ("/sparql/", sparql, ["GET", "POST"]),
        ("/graphs", graph_store, write),
        ("/graphs/{name:path}", graph_store, write),
        ("/dump.{ending:str}", dump, get),
        ("/.well-known/void", dataset_description, get),
        ("/assertions", assertions, ["GET", "POST", "DELETE"]),
        ("/records", records, ["POST"]),
        ("/numbers", numbers, ["POST"]),
        ("/labels", labels, ["POST"]),
        ("/log", log, get),
        ("/diff", diff, get),
        ("/why", why, get),
        ("/timemap", timemap, get),
        ("/changes", changes, get),
        ("/subscribe", subscribe, get),
        ("/health", _health, get),
        ("/metrics", _metrics, get),
        ("/files/{name:str}", _file, get),
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
        routes=routes, lifespan=lifespan, exception_handlers={HTTPException: not_this_way}
    )
    app.router.redirect_slashes = False
    return Guard(app, serving.settings, serving.metrics)


class _Endpoint:
    """One path's answer, with errors of the tree as problems."""

    def __init__(self, serving: Serving, answer: Answer) -> None:
        self._serving, self._answer = serving, answer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        try:
            answer = await self._answer(self._serving, request)
        except HereaboutsError as error:
            answer = problem_response(problem_of(error), request.headers.get("accept"))
        await answer(scope, receive, send)


async def _health(serving: Serving, request: Request) -> Response:
    semantic_map = serving.semantic_map
    told = {
        "status": "ok",
        "map": semantic_map.title,
        "base": semantic_map.base,
        "sequence": semantic_map.sequence,
        **serving.status(),
    }
    return Response(json.dumps(told) + "\n", media_type="application/json")


async def _metrics(serving: Serving, request: Request) -> Response:
    text = await run_in_threadpool(serving.metrics.text)
    return Response(text, headers={"Content-Type": metrics.MEDIA_TYPE})


async def _file(serving: Serving, request: Request) -> Response:
    return file(request)


def file(request: Request) -> Response:
    """A file of the pages; Problem 404 where there is none of that name."""
    name = request.path_params["name"]
    if name not in _FILES:
        raise Problem(404, f"no file {name[:100]!r}; there are: {', '.join(_FILES)}")
    body = files("kg.server").joinpath("files", name).read_bytes()
    return Response(body, media_type=_FILES[name], headers={"Cache-Control": "max-age=300"})


async def not_this_way(request: Request, error: Exception) -> Response:
    """What is told where a path has no answer, or none by that method."""
    assert isinstance(error, HTTPException)
    if error.status_code == 405:
        message = f"{request.method} is not for {request.url.path[:200]}"
    else:
        message = f"nothing is at {request.url.path[:200]}"
    problem = Problem(error.status_code, message, error.headers)
    return problem_response(problem, request.headers.get("accept"))


def _measure(serving: Serving) -> None:
    gauge, feed = serving.metrics.gauge, serving.feed
    gauge(
        "hereabouts_sequence",
        "gauge",
        "Number of the last commit.",
        lambda: serving.semantic_map.sequence,
    )
    gauge(
        "hereabouts_commits_total",
        "counter",
        "Commits since the server started.",
        lambda: feed.commits,
    )
    gauge("hereabouts_query_workers", "gauge", "Worker processes.", lambda: len(serving.pool.pids))
    gauge(
        "hereabouts_query_workers_busy",
        "gauge",
        "Worker processes with a query.",
        lambda: serving.pool.busy,
    )
    gauge("hereabouts_objects", "gauge", "Objects in the map.", lambda: serving.tally.objects)
    gauge(
        "hereabouts_feed_clients",
        "gauge",
        "Clients that follow changes or a query.",
        lambda: feed.followers,
    )
    gauge(
        "hereabouts_feed_dropped_total",
        "counter",
        "Clients dropped for not keeping up.",
        lambda: feed.dropped,
    )
    gauge(
        "hereabouts_standing_queries",
        "gauge",
        "Queries that are followed.",
        lambda: len(serving.standing),
    )
