"""Derived resources, which are not stored: geometries, CRS, sensors, agents, transactions.

Exports contain their IRIs, so a server has to dereference them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from urllib.parse import unquote

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.assertions import agent_quads
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import HistoryError
from kg.model.iris import AGENT, agent_iri, agent_name
from kg.rdf.datetimes import date_time
from kg.rdf.literals import properties_of
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
        known = number.isascii() and number.isdigit() and len(number) < 19
        commit = semantic_map.history.log.commit(int(number)) if known else None
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
