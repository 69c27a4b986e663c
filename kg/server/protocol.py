"""`/sparql`: the SPARQL 1.1 Protocol, query and update."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any, Final, TypeVar

from pyoxigraph import NamedNode
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.commits import ChangeSet
from kg.endpoint import SEQUENCE
from kg.server import bodies
from kg.server.bodies import Parameters
from kg.server.description import service_description
from kg.server.event_stream import disconnected
from kg.server.moments import sequence_at
from kg.server.problems import Problem
from kg.server.serving import Serving
from kg.server.using import with_graphs
from kg.wire import change_to_json

QUERY: Final = "application/sparql-query"
UPDATE: Final = "application/sparql-update"
T = TypeVar("T")


async def sparql(serving: Serving, request: Request) -> Response:
    """Answer a query, carry out an update, or describe the service."""
    url = bodies.query_parameters(request)
    if request.method in ("GET", "HEAD"):
        if "update" in url:
            raise Problem(400, "an update needs POST")
        if "query" not in url:
            return await service_description(serving, request)
        return await _query(serving, request, url)
    kind = bodies.media_type(request)
    if kind == bodies.FORM:
        return await _form(serving, request, url)
    if kind == QUERY:
        _refuse_in_url(url, "query")
        body = bodies.text(await bodies.read_body(request, serving.settings.limits))
        return await _query(serving, request, Parameters((("query", body),)) + url)
    if kind == UPDATE:
        _refuse_in_url(url, "update")
        by = _writer(serving, request)
        body = bodies.text(await bodies.read_body(request, serving.settings.limits))
        return await _update(serving, request, Parameters((("update", body),)) + url, by)
    raise Problem(
        415, f"a body of type {kind[:100] or '(none)'}; use {QUERY}, {UPDATE} or {bodies.FORM}"
    )


async def _form(serving: Serving, request: Request, url: Parameters) -> Response:
    form = bodies.form_parameters(await bodies.read_body(request, serving.settings.limits))
    if ("query" in form) == ("update" in form):
        raise Problem(400, "the form needs either 'query' or 'update'")
    _refuse_in_url(url, "query")
    _refuse_in_url(url, "update")
    if "query" in form:
        return await _query(serving, request, form + url)
    return await _update(serving, request, form + url, _writer(serving, request))


async def _query(serving: Serving, request: Request, given: Parameters) -> Response:
    moment = given.one("at")
    at = None if moment is None else await sequence_at(serving.semantic_map, moment)
    query = asyncio.ensure_future(
        serving.pool.run_async(
            given.one("query") or "",
            base=serving.semantic_map.base,
            accept=request.headers.get("accept"),
            default_graphs=graphs_of(given, "default-graph-uri"),
            named_graphs=graphs_of(given, "named-graph-uri"),
            at_least=max(serving.written, _least(serving, request)),
            at=at,
        )
    )
    answer = await unless_gone(request, query)
    return Response(
        answer.body,
        media_type=answer.media_type,
        headers={"Vary": "Accept", SEQUENCE: str(answer.sequence)},
    )


def _least(serving: Serving, request: Request) -> int:
    """The transaction the client knows of already; Problem where the map has not got so far."""
    given = request.headers.get(SEQUENCE, "0")
    if not (given.isascii() and given.isdigit() and len(given) < 19):
        raise Problem(400, f"{SEQUENCE} must be a sequence number, got {given[:40]!r}")
    if int(given) > serving.semantic_map.sequence:
        now = serving.semantic_map.sequence
        raise Problem(412, f"this map is at {now}, not at {given}; read it anew")
    return int(given)


async def unless_gone(request: Request, query: asyncio.Future[T]) -> T:
    """The query's answer; a client that leaves takes its query with it."""
    gone = asyncio.ensure_future(disconnected(request.receive))
    try:
        waiting: set[asyncio.Future[Any]] = {query, gone}
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        if not query.done():
            query.cancel()
            await asyncio.gather(query, return_exceptions=True)
            raise Problem(400, "the client left before its answer was ready")
        return query.result()
    finally:
        gone.cancel()
        query.cancel()


async def _update(serving: Serving, request: Request, given: Parameters, by: str) -> Response:
    if "at" in given:
        raise Problem(400, "the past cannot be written: leave out 'at'")
    text = with_graphs(
        given.one("update") or "",
        graphs_of(given, "using-graph-uri"),
        graphs_of(given, "using-named-graph-uri"),
    )
    return await write(serving, request, text, by)


async def write(
    serving: Serving,
    request: Request,
    update: str,
    by: str,
    check: Callable[[], None] | None = None,
) -> Response:
    """Carry out an update; the answer says what it changed, and under which number.

    `check` may refuse it, right before: nobody writes in between.
    """

    def act() -> ChangeSet | None:
        with serving.semantic_map.hold():
            if check is not None:
                check()
            return serving.semantic_map.update(update, by=by)

    # a client that leaves meanwhile must not leave half of a decision behind
    return written(serving, await asyncio.shield(run_in_threadpool(act)), request)


def written(
    serving: Serving, change: ChangeSet | None, request: Request, **more: object
) -> Response:
    """The answer to a request that wrote `change`: counts, its number, and what else there is.

    Who prefers `return=representation` (RFC 7240) is told the change set itself as well.
    """
    sequence = change.sequence if change else serving.semantic_map.sequence
    serving.written = max(serving.written, sequence)
    headers = {SEQUENCE: str(sequence)}
    if "return=representation" in request.headers.get("prefer", "").replace(" ", ""):
        more["change"] = change_to_json(change) if change else None
        headers["Preference-Applied"] = "return=representation"
    done = {
        "sequence": sequence,
        "added": len(change.added) if change else 0,
        "removed": len(change.removed) if change else 0,
        **more,
    }
    body = json.dumps(done, ensure_ascii=False) + "\n"
    return Response(body, media_type="application/json", headers=headers)


def _writer(serving: Serving, request: Request) -> str:
    return serving.settings.tokens.holder(request.headers.get("authorization"))


def graphs_of(given: Parameters, name: str) -> tuple[str, ...]:
    """The graphs a request names by that parameter; Problem 400 where one is no absolute IRI."""
    for iri in given.all(name):
        try:
            NamedNode(iri)
        except ValueError as error:
            raise Problem(400, f"{name} must be an absolute IRI, got {iri[:100]!r}") from error
    return given.all(name)


def _refuse_in_url(url: Parameters, name: str) -> None:
    if name in url:
        raise Problem(400, f"{name!r} stands in the URL of a POST with a body; give one of them")
