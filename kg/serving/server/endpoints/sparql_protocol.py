"""`/sparql`: the SPARQL 1.1 Protocol, query and update."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from pyoxigraph import NamedNode
from starlette.requests import Request
from starlette.responses import Response

from kg.model.errors import DiskFullError
from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import change_to_json
from kg.serving.server.app_state import AppState
from kg.serving.server.http import bodies
from kg.serving.server.http.bodies import RequestParameters
from kg.serving.server.http.event_stream import unless_gone
from kg.serving.server.http.media_types import accept_of
from kg.serving.server.http.middleware import is_confirmed
from kg.serving.server.http.problems import Problem, sequence_at
from kg.serving.server.linked_data.descriptions import service_description
from kg.serving.workers.process import Answer
from kg.serving.workers.request import query_call
from kg.serving.workers.updates import UpdateRequest, update_map
from kg.store.sparql_client import SEQUENCE

QUERY: Final = "application/sparql-query"
UPDATE: Final = "application/sparql-update"
NOTE: Final = "Here-Note"  # header of an answer: terms of the query that the map lacks
MAX_NOTE: Final = 1000  # characters


async def sparql(serving: AppState, request: Request) -> Response:
    """Answer a query, execute an update, or describe the service."""
    url = bodies.query_parameters(request)
    if request.method in ("GET", "HEAD"):
        if "update" in url:
            raise Problem(400, "an update needs POST")
        if "query" not in url:
            return await service_description(serving, request)
        return await _query(serving, request, url)
    for name in ("query", "update"):
        if name in url:
            raise Problem(400, f"{name!r} is in the URL of a POST with a body; give one of them")
    given = await _posted(serving, request) + url
    if ("query" in given) == ("update" in given):
        raise Problem(400, "the form needs either 'query' or 'update'")
    if "query" in given:
        return await _query(serving, request, given)
    return await _update(serving, request, given, serving.author_of(request))


async def _posted(serving: AppState, request: Request) -> RequestParameters:
    """The parameters in the body: a form, a query or an update."""
    kind = bodies.media_type(request)
    if kind not in (bodies.FORM, QUERY, UPDATE):
        raise Problem(
            415, f"a body of type {kind[:100] or '(none)'}; use {QUERY}, {UPDATE} or {bodies.FORM}"
        )
    if kind == UPDATE:
        serving.author_of(request)  # before the body is read
    body = await bodies.read_body(request, serving.settings.limits)
    if kind == bodies.FORM:
        return bodies.form_parameters(body)
    return RequestParameters((("query" if kind == QUERY else "update", bodies.text(body)),))


async def _query(serving: AppState, request: Request, given: RequestParameters) -> Response:
    moment = given.one("at")
    at = None if moment is None else await sequence_at(serving.semantic_map, moment)
    client = request.state.client
    call = partial(
        query_call,
        given.one("query") or "",
        base=serving.semantic_map.base,
        accept=accept_of(request, given),
        default_graphs=graphs_of(given, "default-graph-uri"),
        named_graphs=graphs_of(given, "named-graph-uri"),
        at=at,
        client=client,
    )
    least = _least(serving, request)
    seen = max(serving.sessions.at_least(client), least)
    try:
        answer = await unless_gone(request, serving.pool.answer_async(call(at_least=seen)))
    except DiskFullError:
        if seen == least:
            raise
        # no new snapshot can be made: the last one, whose number the response states
        answer = await unless_gone(request, serving.pool.answer_async(call(at_least=least)))
    if at is None:
        serving.sessions.saw(client, answer.sequence)
    return Response(
        answer.body,
        media_type=answer.media_type,
        headers={"Vary": "Accept", SEQUENCE: str(answer.sequence), **_notes(answer)},
    )


def _notes(answer: Answer) -> dict[str, str]:
    """A header that names the terms of a query that the map lacks."""
    text = "; ".join(answer.details.get("notes", ()))
    return {NOTE: text[:MAX_NOTE].encode("ascii", "backslashreplace").decode()} if text else {}


def _least(serving: AppState, request: Request) -> int:
    """The last transaction that the client has seen; Problem 412 if the map has no such number."""
    given = bodies.number_in(request.headers.get(SEQUENCE, "0"), SEQUENCE)
    if given > (now := serving.semantic_map.sequence):
        raise Problem(412, f"this map is at transaction {now}, not at {given}; read it again")
    return given


async def _update(
    serving: AppState, request: Request, given: RequestParameters, by: str
) -> Response:
    if "at" in given:
        raise Problem(400, "the past cannot be written: leave out 'at'")
    update = UpdateRequest(
        given.one("update") or "",
        graphs_of(given, "using-graph-uri"),
        graphs_of(given, "using-named-graph-uri"),
    )
    notes: list[str] = []
    act = partial(
        update_map,
        *(serving.pool, serving.semantic_map, update),
        by=by,
        confirmed=is_confirmed(request),
        explain=notes.append,
    )
    change = await serving.write(request, act)
    told = {"note": notes[0]} if any(notes) else {}
    return written(serving, change, request, **told)


async def write(
    serving: AppState, request: Request, act: Callable[[], ChangeSet | None]
) -> Response:
    """Execute an update; the response has counts and the number of the transaction."""
    return written(serving, await serving.write(request, act), request)


def written(
    serving: AppState, change: ChangeSet | None, request: Request, **more: object
) -> Response:
    """Response to a request that wrote `change`: its number, counts, notes and `more` members.

    With the preference `return=representation` (RFC 7240) it has the change set as well.
    """
    sequence = change.sequence if change else serving.semantic_map.sequence
    serving.sessions.saw(request.state.client, sequence)
    headers = {SEQUENCE: str(sequence)}
    if "return=representation" in request.headers.get("prefer", "").replace(" ", ""):
        more["change"] = change_to_json(change) if change else None
        headers["Preference-Applied"] = "return=representation"
    if change is not None and change.notes:
        more["notes"] = list(change.notes)
    done = {
        "sequence": sequence,
        "added": len(change.added) if change else 0,
        "removed": len(change.removed) if change else 0,
        **more,
    }
    return bodies.json_response(done, headers)


def graphs_of(given: RequestParameters, name: str) -> tuple[str, ...]:
    """The graphs in a parameter of a request; Problem 400 for an IRI that is not absolute."""
    for iri in given.all(name):
        try:
            NamedNode(iri)
        except ValueError as error:
            raise Problem(400, f"{name} must be an absolute IRI, got {iri[:100]!r}") from error
    return given.all(name)
