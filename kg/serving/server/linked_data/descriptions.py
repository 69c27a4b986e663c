"""Descriptions: of the service (SPARQL Service Description, VoID, DCAT), and of each resource.

A resource is described by its facts in the graph, those derived from them, and its address. Derived
resources (geometries, CRS, sensors, agents, transactions) are not stored, but exports contain their
IRIs, so a server has to dereference them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from itertools import islice
from typing import Final
from urllib.parse import parse_qsl, quote, unquote

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, RdfFormat, Triple, parse
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from kg.export.serialization import prefixes_of
from kg.maps.facts.assertions import agent_quads
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.query.query_files import find_query
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, QueryError
from kg.model.iris import AGENT, agent_iri, agent_name, whole_number
from kg.rdf.literals import date_time, properties_of
from kg.rdf.standard_terms import (
    CRS,
    FOOTPRINT,
    GEOMETRY,
    PROGRAM,
    SENSOR,
    crs_quads,
    geometry_quads,
    program_quads,
    sensor_quads,
    standard_quads,
)
from kg.serving.server.app_state import AppState
from kg.serving.server.http.media_types import HTML, SOLUTIONS, document, negotiated
from kg.serving.server.http.problems import Problem
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


MAX_OUTGOING: Final = 1000  # facts of one resource that are shown
MAX_INCOMING: Final = 200  # facts that refer to it
_SAFE_PATH: Final = "/:@!$&'()*+,;=-._~%"


@dataclass(frozen=True, slots=True)
class ResourceDescription:
    """A resource, the facts `about` it (and its blank nodes), and the facts that refer to it."""

    iri: str
    about: tuple[Quad, ...]
    referring: tuple[Quad, ...]


def look_up(semantic_map: SemanticMap, iri: str) -> ResourceDescription:
    """Stored and derived facts of `iri`; Problem 404 if there are none."""
    try:
        node = NamedNode(iri)
    except ValueError as error:
        raise Problem(404, f"{iri[:200]!r} is not a valid IRI") from error
    engine = semantic_map.engine
    about = list(islice(engine.quads_for_pattern(node, None, None), MAX_OUTGOING))
    for quad in about:
        if isinstance(quad.object, BlankNode) and len(about) < MAX_OUTGOING:
            about += islice(engine.quads_for_pattern(quad.object, None, None), MAX_OUTGOING)
    referring = tuple(islice(engine.quads_for_pattern(None, None, node), MAX_INCOMING))
    about += [quad for quad in derived_quads(semantic_map, iri) if quad not in about]
    if not about and not referring:
        raise Problem(404, f"this map has no {iri[:200]}")
    return ResourceDescription(iri, tuple(about), referring)


def iri_at(base: str, root: str, address: str) -> str:
    """The IRI of the resource at an address of this server, `root`; other IRIs stay as they are.

    A proxy may have merged the slashes behind the scheme of `address`.
    """
    address = re.sub(r"^(https?):/+", r"\1://", address)
    if not address.startswith(root):
        return address
    path, _, query = address.removeprefix(root).partition("?")
    if path == "resource":
        return dict(parse_qsl(query)).get("iri", "")
    return base + path


def local_path(base: str, iri: str) -> str:
    """Path of an IRI on this server; it never begins with ``//``, the address of another host."""
    if iri.startswith(base) and not iri.startswith(base + "/"):
        return "/" + quote(iri.removeprefix(base), safe=_SAFE_PATH)
    return "/resource?iri=" + quote(iri, safe="")


COMMIT: Final = "commit/"  # IRI of a transaction: base, this, number
_PARTS: Final = (GEOMETRY, FOOTPRINT, "/time", "/association")  # of a stored resource


def derived_quads(semantic_map: SemanticMap, iri: str) -> tuple[Quad, ...]:
    """Derived facts about the resource `iri`; empty if there are none."""
    if not iri.startswith(semantic_map.base):
        return tuple(_of_term(semantic_map, iri))
    node = NamedNode(iri)
    return tuple(quad for quad in _of_map(semantic_map, iri) if quad.subject == node)


def _of_map(semantic_map: SemanticMap, iri: str) -> Iterator[Quad]:
    base = semantic_map.base
    name = iri.removeprefix(base)
    if name == CRS:
        yield from crs_quads(base)
    elif name == PROGRAM:
        yield from program_quads(base)
    elif name == "ontology":
        yield Quad(NamedNode(iri), v.RDF_TYPE, NamedNode(v.OWL_ONTOLOGY), v.MAP_GRAPH)
    elif name.startswith(SENSOR):
        model = Literal(unquote(name.removeprefix(SENSOR)))
        quads = semantic_map.engine.quads_for_pattern(None, NamedNode(v.MODEL), model, v.MAP_GRAPH)
        if next(iter(quads), None) is not None:
            yield from sensor_quads(base, iri)
    elif name.startswith(AGENT):
        yield from _of_agent(semantic_map, iri)
    elif name.startswith(COMMIT):
        yield from _of_commit(semantic_map, iri)
    else:
        yield from _of_stored(semantic_map, iri)


def _of_stored(semantic_map: SemanticMap, iri: str) -> Iterator[Quad]:
    """Feature, SOSA and PROV-O facts of a stored resource or of a part of one."""
    base = semantic_map.base
    part = next((part for part in _PARTS if iri.endswith(part)), "")
    thing = iri.removesuffix(part)
    properties = properties_of(semantic_map.engine, thing, v.MAP_GRAPH)
    if not properties:
        return
    quads = semantic_map.engine.quads_for_pattern(NamedNode(thing), None, None, v.MAP_GRAPH)
    objects = RecordCodec(semantic_map.base, semantic_map.catalogue).objects_among(quads)
    is_place = v.PLACE in properties.get(v.RDF_TYPE.value, ())
    places = tuple(p for p in semantic_map.places() if p.iri == thing) if is_place else ()
    robot = semantic_map.robot() if thing == base + "robot" else None
    if objects or places or robot:
        yield from geometry_quads(base, objects, places, robot)
    yield from standard_quads(base, {thing: properties})


def _of_agent(semantic_map: SemanticMap, iri: str) -> Iterator[Quad]:
    """Facts about the author of a transaction; authors of assertions are stored."""
    name = agent_name(semantic_map.base, iri)
    try:
        known = semantic_map.history.log.has_author(name)
    except HistoryError:
        known = False
    if known:
        yield from agent_quads(semantic_map.base, name, v.HISTORY_GRAPH)


def _of_commit(semantic_map: SemanticMap, iri: str) -> Iterator[Quad]:
    """A transaction as an activity of PROV-O, with its association."""
    number = iri.removeprefix(semantic_map.base + COMMIT).removesuffix("/association")
    try:
        known = whole_number(number)
        commit = None if known is None else semantic_map.history.log.commit(known)
    except HistoryError:
        commit = None
    if commit is None:
        return
    node = NamedNode(f"{semantic_map.base}{COMMIT}{number}")
    cause = commit.cause
    label = f"transaction {number}: {cause.kind} {cause.note}".strip()
    facts: list[tuple[NamedNode, str, NamedNode | Literal]] = [
        (node, v.RDF_TYPE.value, NamedNode(v.PROV_ACTIVITY)),
        (node, v.RDFS_LABEL, Literal(label)),
        (node, v.PROV_ENDED_AT, date_time(commit.time)),
    ]
    if cause.by:
        agent = NamedNode(agent_iri(semantic_map.base, cause.by))
        association = NamedNode(f"{node.value}/association")
        facts += [
            (node, v.PROV_ASSOCIATED_WITH, agent),
            (node, v.PROV_QUALIFIED_ASSOCIATION, association),
            (association, v.RDF_TYPE.value, NamedNode(v.PROV_ASSOCIATION)),
            (association, v.PROV_HAS_AGENT, agent),
        ]
    for subject, predicate, value in facts:
        yield Quad(subject, NamedNode(predicate), value, v.HISTORY_GRAPH)


def _of_term(semantic_map: SemanticMap, iri: str) -> Iterator[Quad]:
    """Facts about a graph, or about a term that the map uses without describing it."""
    node, kind = NamedNode(iri), v.RDF_TYPE
    engine = semantic_map.engine
    if next(iter(engine.quads_for_pattern(None, None, None, node)), None) is not None:
        yield Quad(node, kind, NamedNode(v.SD_NAMED_GRAPH), v.MAP_GRAPH)
    used = next(iter(engine.quads_for_pattern(None, node, None)), None) is not None
    if used or iri in _TERMS:
        namespace = iri[: max(iri.rfind("#"), iri.rfind("/")) + 1]
        yield Quad(node, NamedNode(v.RDFS_DEFINED_BY), NamedNode(namespace), v.MAP_GRAPH)


#: terms of other vocabularies in derived facts
_TERMS: Final = frozenset(term for term in vars(v).values() if isinstance(term, str))
