"""`/graphs`: the SPARQL 1.1 Graph Store HTTP Protocol.

The graph is ``?graph=IRI`` or a path, ``/graphs/map`` for graph:map. ``?default`` reads
the union of all graphs, as a query without GRAPH does, and adds to graph:map, as an update does.
Relative IRIs of a body are the map's, as in queries and updates: <object/17> is its object 17.
A PUT to graph:ontology is validated and compiled, and replaces the ontology of the map.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, closing
from dataclasses import asdict
from functools import partial
from typing import Final, cast

from pyoxigraph import NamedNode, Quad, RdfFormat, Triple, serialize
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from kg.export.serialization import prefixes_of
from kg.maps.update.change_draft import GroundUpdate, QuadChange
from kg.model import vocabulary as v
from kg.model.errors import HereaboutsError
from kg.model.transactions import ChangeSet
from kg.rdf.literals import in_xml
from kg.rdf.skolem import anonymous_triple
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import write, written
from kg.serving.server.http import bodies
from kg.serving.server.http.media_types import negotiated
from kg.serving.server.http.middleware import is_confirmed
from kg.serving.server.http.problems import (
    Problem,
    State,
    check_preconditions,
    problem_of,
    problem_response,
)
from kg.serving.workers.content_negotiation import ALIASES, GRAPH_TYPES
from kg.serving.workers.ontology_worker import OntologyDocument, replace_ontology
from kg.serving.workers.updates import parsed_document
from kg.store.sparql_client import SEQUENCE

_DUMPS: Final = {"trig": RdfFormat.TRIG, "nq": RdfFormat.N_QUADS}
#: media types of a single graph, of those that have no names of graphs
_TYPES: Final = tuple(
    name for name in GRAPH_TYPES if RdfFormat.from_media_type(name) not in _DUMPS.values()
)
_BODIES: Final = tuple(name for name in _TYPES if name not in ALIASES)

log = logging.getLogger("hereabouts.server")


async def graph_store(serving: AppState, request: Request) -> Response:
    """Read, replace, extend or delete a graph."""
    graph = _graph(request)
    if request.method in ("GET", "HEAD"):
        return await _read(serving, request, graph)
    by = serving.author_of(request)
    if graph is None and request.method != "POST":
        raise Problem(403, "the default graph is the union of all: name the graph to change")
    target = graph or v.MAP_GRAPH
    existed = _has(serving, target)
    check = partial(_check_preconditions, serving, request, graph)
    if request.method == "DELETE":
        if not existed:
            raise _unknown(target)
        clear = partial(_replace, serving, target, None, by, check, is_confirmed(request))
        return await write(serving, request, clear)
    body, form = await _body(serving, request)
    if request.method == "PUT" and target == v.ONTOLOGY_GRAPH:
        return await _take_ontology(serving, request, (body, form), by, check)
    triples = await _triples_of(serving, body, form)
    change = partial(_extend, serving, target, triples, by, check)
    if request.method == "PUT":
        change = partial(_replace, serving, target, triples, by, check, is_confirmed(request))
    answer = await write(serving, request, change)
    answer.status_code = 200 if existed else 201
    return answer


def _replace(
    serving: AppState,
    graph: NamedNode,
    triples: list[Triple] | None,
    by: str,
    check: Callable[[], None],
    confirmed: bool,
) -> ChangeSet | None:
    """Replace the triples of a graph; None deletes them."""
    steps = () if triples is None else (_insertion(graph, triples),)
    return serving.semantic_map.apply_ground(
        GroundUpdate(steps),
        f"{'DELETE' if triples is None else 'PUT'} {graph}",
        by=by,
        confirmed=confirmed,
        replaced=graph,
        check=check,
    )


def _extend(
    serving: AppState,
    graph: NamedNode,
    triples: list[Triple],
    by: str,
    check: Callable[[], None],
) -> ChangeSet | None:
    """Add triples to a graph."""
    update = GroundUpdate((_insertion(graph, triples),))
    return serving.semantic_map.apply_ground(update, f"POST {graph}", by=by, check=check)


def _insertion(graph: NamedNode, triples: list[Triple]) -> QuadChange:
    return QuadChange((), tuple(Quad(t.subject, t.predicate, t.object, graph) for t in triples))


async def _take_ontology(
    serving: AppState,
    request: Request,
    given: tuple[bytes, RdfFormat],
    by: str,
    check: Callable[[], None],
) -> Response:
    """Replace the ontology of the map; the response describes the changes."""
    whole = bodies.query_parameters(request).flag("whole")
    client = request.state.client
    document = OntologyDocument(*given, serving.semantic_map.base, whole, client)
    work = serving.pool.ontologies, serving.semantic_map, document
    taken = await serving.write(request, partial(replace_ontology, *work, by=by, check=check))
    return written(
        serving,
        taken.commit,
        request,
        changes=[asdict(change) for change in taken.changes],
        kept=list(taken.kept),
        warnings=[asdict(warning) for warning in taken.warnings],
    )


async def dump(serving: AppState, request: Request) -> ASGIApp:
    """All named graphs as TriG or N-Quads, by the ending of the path; else Problem 404."""
    ending = request.path_params["ending"]
    if ending not in _DUMPS:
        known = " and ".join(f"/dump.{name}" for name in _DUMPS)
        raise Problem(404, f"no dump ends in {ending[:40]!r}; there are {known}")
    media_type = _DUMPS[ending].media_type
    headers = {"Content-Type": media_type}
    if request.method == "HEAD":
        return Response(headers=headers)
    wanted = {"media_type": media_type, "prefixes": prefixes_of(serving.semantic_map.base)}
    return DumpStream(serving.pool.dump(wanted, request.state.client), headers)


async def _read(serving: AppState, request: Request, graph: NamedNode | None) -> Response:
    media_type = negotiated(request, _TYPES)
    form = cast(RdfFormat, RdfFormat.from_media_type(media_type))
    if graph is not None and not _has(serving, graph):
        raise _unknown(graph)
    sequence = serving.semantic_map.sequence
    state = _state(serving, graph, form.file_extension)
    headers = {"Vary": "Accept", SEQUENCE: str(sequence), **state.headers}
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    body = await serving.read(request, partial(_serialised, serving, graph, form))
    return Response(body, media_type=media_type, headers=headers)


def _state(serving: AppState, graph: NamedNode | None, form: str) -> State:
    """State of a graph: the last transaction that changed it, or the map for None."""
    changed = serving.changed
    return State(serving.semantic_map.sequence if graph is None else changed.last(graph), form)


def _check_preconditions(serving: AppState, request: Request, graph: NamedNode | None) -> None:
    exists = graph is None or _has(serving, graph)
    check_preconditions(request, _state(serving, graph, ""), exists=exists)


def _triples(serving: AppState, graph: NamedNode | None) -> Generator[Triple, None, None]:
    quads = serving.semantic_map.engine.quads_for_pattern(None, None, None, graph)
    seen: set[Triple] = set()
    for quad in quads:
        if graph is None:
            # a triple may be in several graphs
            if quad.triple in seen:
                continue
            seen.add(quad.triple)
        yield anonymous_triple(quad.triple)


def _serialised(serving: AppState, graph: NamedNode | None, form: RdfFormat) -> bytes:
    # an iterator of the engine aborts the process if another thread uses it
    with closing(_triples(serving, graph)) as statements:
        out = _Capped(serving.settings.limits.result)
        try:
            serialize(statements, out, form, prefixes=prefixes_of(serving.semantic_map.base))
        except OSError as error:
            raise out.too_long() from error
        body = out.getvalue()
        return in_xml(body) if form == RdfFormat.RDF_XML else body


class _Capped(io.BytesIO):
    """Buffer of at most `limit` bytes."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self._limit = limit

    def write(self, data: bytes) -> int:  # type: ignore[override]
        """Append; raises Problem 503 beyond the limit."""
        if self.tell() + len(data) > self._limit:
            raise self.too_long()
        return super().write(data)

    def too_long(self) -> Problem:
        """The problem of a longer response."""
        return Problem(503, f"the answer has more than {self._limit} bytes; query for a part of it")


def _graph(request: Request) -> NamedNode | None:
    """The graph of a request; None for the default graph."""
    path = request.path_params.get("name")
    given = bodies.query_parameters(request)
    iri = given.one("graph")
    if path:
        if "graph" in given or "default" in given:
            raise Problem(400, "the path names the graph; leave out ?graph and ?default")
        iri = v.GRAPH + path
    elif (iri is None) == ("default" not in given):
        raise Problem(400, "name one graph: ?graph=IRI, ?default, or /graphs/map")
    try:
        return None if iri is None else NamedNode(iri)
    except ValueError as error:
        raise Problem(400, f"a graph needs an absolute IRI, got {iri!r:.100}") from error


def _has(serving: AppState, graph: NamedNode) -> bool:
    quads = serving.semantic_map.engine.quads_for_pattern(None, None, None, graph)
    return next(iter(quads), None) is not None


def _unknown(graph: NamedNode) -> Problem:
    return Problem(404, f"no graph {graph.value} in this map, or nothing in it")


async def _body(serving: AppState, request: Request) -> tuple[bytes, RdfFormat]:
    """The body of a request, and its format."""
    kind = bodies.media_type(request)
    if kind not in _BODIES:
        known = ", ".join(_BODIES)
        raise Problem(415, f"a body of type {kind[:100] or '(none)'}; there are: {known}")
    form = cast(RdfFormat, RdfFormat.from_media_type(kind))
    return await bodies.read_body(request, serving.settings.limits), form


async def _triples_of(serving: AppState, body: bytes, form: RdfFormat) -> list[Triple]:
    base = serving.semantic_map.base
    quads = await run_in_threadpool(partial(parsed_document, serving.pool, body, form, base))
    return [quad.triple for quad in quads]


class DumpStream:
    """ASGI response that sends a dump and then closes it.

    A failure before the first part is a problem response. A later one aborts the connection, so
    that a client does not take a part of the map for the whole.
    """

    def __init__(
        self, dump: AbstractAsyncContextManager[Iterator[bytes]], headers: Mapping[str, str]
    ) -> None:
        self._dump, self._headers = dump, headers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        begun = False
        try:
            async with self._dump as parts:
                part = await run_in_threadpool(next, parts, b"")
                raw = [(k.lower().encode(), v.encode()) for k, v in self._headers.items()]
                await send({"type": "http.response.start", "status": 200, "headers": raw})
                begun = True
                while part:
                    await send({"type": "http.response.body", "body": part, "more_body": True})
                    part = await run_in_threadpool(next, parts, b"")
                await send({"type": "http.response.body", "body": b""})
        except HereaboutsError as error:
            if begun:
                log.error("a dump broke off: %s", error)
                scope["state"]["connection"].abort()
            else:
                await problem_response(problem_of(error), None)(scope, receive, send)
