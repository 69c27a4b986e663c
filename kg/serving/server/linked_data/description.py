"""Service description of the server: SPARQL Service Description, VoID and DCAT."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import partial
from importlib.resources import files

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from kg.export.serialization import prefixes_of
from kg.maps.query.query_files import find_query
from kg.model import vocabulary as v
from kg.model.errors import QueryError
from kg.serving.server.app_state import AppState
from kg.serving.server.http.media_types import HTML, SOLUTIONS, document, negotiated
from kg.serving.server.moments import at_moment, present_of
from kg.serving.workers.content_negotiation import GRAPH_TYPES
from kg.serving.workers.process import Answer

_THE_MAP = NamedNode("https://w3id.org/hereabouts/the-map")  # placeholder for the map in the files


async def service_description(serving: AppState, request: Request) -> Response:
    """The endpoint as a SPARQL 1.1 Service Description; browsers are sent to the front page."""
    media_type = negotiated(request)
    if media_type == HTML:
        return RedirectResponse("/#ask", status_code=303, headers={"Vary": "Accept"})
    root = str(request.base_url)
    triples = _read("service.ttl", root)
    if serving.settings.tokens:
        triples += _read("update.ttl", root)
    if serving.settings.services:
        triples += _read("federated.ttl", root)
    return _answer(triples, media_type, serving)


async def dataset_description(serving: AppState, request: Request) -> Response:
    """The map as a VoID and DCAT dataset: metadata, counts and downloads."""
    media_type = negotiated(request, GRAPH_TYPES)
    moment, root = present_of(serving, request), str(request.base_url)
    describe = partial(_described, serving, media_type, root, moment.sequence)

    async def make() -> Answer:
        return await serving.read(request, describe)

    version = (media_type, root)
    return await at_moment(
        serving, request, moment, make, version=version, vary="Accept, Accept-Encoding"
    )


def _described(serving: AppState, media_type: str, root: str, sequence: int) -> Answer:
    triples = _dataset(serving, root, sequence)
    body = document(triples, media_type, prefixes_of(serving.semantic_map.base))
    return Answer(media_type, body, sequence)


def graph_sizes(serving: AppState, sequence: int) -> dict[str, int]:
    """Number of triples of each named graph; empty if the query takes too long."""
    sparql = find_query("graph-sizes").bind({}, lambda kind, text: text)
    try:
        answer = serving.pool.run(sparql, accept=SOLUTIONS, at_least=sequence)
    except QueryError:
        return {}
    rows = json.loads(answer.body)["results"]["bindings"]
    return {row["graph"]["value"]: int(row["triples"]["value"]) for row in rows}


def _dataset(serving: AppState, root: str, sequence: int) -> list[Triple]:
    base = NamedNode(serving.semantic_map.base)
    graph = v.DATASET_GRAPH
    triples = _read("dataset.ttl", root, {_THE_MAP: base})
    quads = serving.semantic_map.engine.quads_for_pattern(base, None, None, graph)
    triples += [quad.triple for quad in quads]
    sizes = graph_sizes(serving, sequence)
    if sizes:
        triples.append(_count(base, v.VOID_TRIPLES, sum(sizes.values())))
    triples += _classes(serving, base)
    return triples


def _classes(serving: AppState, base: NamedNode) -> Iterable[Triple]:
    summary = serving.semantic_map.query("summary").records()
    catalogue = serving.semantic_map.catalogue
    total = 0
    for number, row in enumerate(summary):
        part, count = BlankNode(f"class{number}"), int(str(row["count"]))
        total += count
        yield Triple(base, NamedNode(v.VOID_CLASS_PARTITION), part)
        category = catalogue.find(str(row["category"])).iri
        yield Triple(part, NamedNode(v.VOID_CLASS), NamedNode(category))
        yield _count(part, v.VOID_ENTITIES, count)
    yield _count(base, v.VOID_ENTITIES, total)


def _count(subject: NamedNode | BlankNode, predicate: str, number: int) -> Triple:
    return Triple(subject, NamedNode(predicate), Literal(number))


def _read(
    name: str, root: str, replaced: Mapping[NamedNode, NamedNode] | None = None
) -> list[Triple]:
    text = files("kg.serving.server").joinpath("files", name).read_text(encoding="utf-8")
    swap = dict(replaced or {})
    return [
        Triple(swap.get(q.subject, q.subject), q.predicate, swap.get(q.object, q.object))
        for q in parse(text, format=RdfFormat.TURTLE, base_iri=root)
    ]


def _answer(triples: list[Triple], media_type: str, serving: AppState) -> Response:
    body = document(triples, media_type, prefixes_of(serving.semantic_map.base))
    return Response(body, media_type=media_type, headers={"Vary": "Accept"})
