"""Derived triples in standard vocabularies: SSN/SOSA, PROV-O, OWL-Time and GeoSPARQL.

They follow from stored triples, so the map does not store them; exports and the documents of
resources contain them. GeoSPARQL reads a geometry without a coordinate reference system as
longitude and latitude, so each geometry names the map's own: metres in a local frame with z up.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from urllib.parse import quote, unquote

import numpy as np
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Triple

from kg.model import vocabulary as v
from kg.model.iris import whole_number
from kg.model.records import ObjectRecord, PlaceRecord, RobotRecord
from kg.rdf.literals import Properties, first, polygon_text

_STAMP = NamedNode(v.XSD + "dateTimeStamp")
SENSOR = "sensor/"  # + the model's name, after the map's IRI
PROGRAM = "agent/hereabouts"  # the agent of searches, after the map's IRI
GEOMETRY = "/geometry"  # after the IRI of a feature
FOOTPRINT = "/footprint"  # after the IRI of an object with an extent
CRS = "crs"  # after the map's IRI: its coordinate reference system

_Fact = tuple[str, str, NamedNode | Literal]


def standard_quads(base: str, subjects: Mapping[str, Properties]) -> Iterator[Quad]:
    """Triples derived from the observations and searches among `subjects`."""
    facts: dict[_Fact, None] = {}
    for iri, properties in subjects.items():
        types = properties.get(v.RDF_TYPE.value, ())
        if v.SOSA_OBSERVATION in types:
            facts.update(dict.fromkeys(_of_observation(base, iri, properties)))
        if v.SEARCH in types:
            facts.update(dict.fromkeys(_of_search(base, iri)))
    return _quads(facts)


def _quads(facts: Iterable[_Fact]) -> Iterator[Quad]:
    for subject, predicate, value in facts:
        yield Quad(NamedNode(subject), NamedNode(predicate), value, v.MAP_GRAPH)


def sensor_quads(base: str, iri: str) -> Iterator[Quad]:
    """Type, label and observed property of a sensor: a detection network."""
    return _quads(_of_sensor(iri, unquote(iri.removeprefix(base + SENSOR))))


def program_quads(base: str) -> Iterator[Quad]:
    """Types and label of the agent that carries out searches."""
    return _quads(_of_program(base))


def _of_observation(base: str, iri: str, properties: Properties) -> Iterator[_Fact]:
    """SOSA, sections 4.3 and 4.5: sensor, observed property, result and phenomenon time."""
    model, score = first(properties, v.MODEL, ""), first(properties, v.SCORE, "")
    stamp = first(properties, v.SOSA_RESULT_TIME, "")
    yield iri, v.SOSA_OBSERVED_PROPERTY, NamedNode(v.EXISTENCE)
    if model:
        sensor = base + SENSOR + quote(model, safe="")
        yield iri, v.SOSA_MADE_BY_SENSOR, NamedNode(sensor)
        yield from _of_sensor(sensor, model)
    if score:
        yield iri, v.SOSA_SIMPLE_RESULT, Literal(score, datatype=v.XSD_DOUBLE)
    if stamp:
        instant = iri + "/time"
        yield iri, v.SOSA_PHENOMENON_TIME, NamedNode(instant)
        yield instant, v.RDF_TYPE.value, NamedNode(v.TIME_INSTANT)
        yield instant, v.TIME_IN_STAMP, Literal(stamp, datatype=_STAMP)
    yield v.EXISTENCE, v.RDF_TYPE.value, NamedNode(v.SOSA_OBSERVABLE_PROPERTY)


def _of_sensor(iri: str, model: str) -> Iterator[_Fact]:
    yield iri, v.RDF_TYPE.value, NamedNode(v.SOSA_SENSOR)
    yield iri, v.RDFS_LABEL, Literal(model)
    yield iri, v.SOSA_OBSERVES, NamedNode(v.EXISTENCE)


def _of_search(base: str, iri: str) -> Iterator[_Fact]:
    """PROV-O, section 3.3: an activity with a qualified association to its agent."""
    agent, association = NamedNode(base + PROGRAM), iri + "/association"
    yield iri, v.RDF_TYPE.value, NamedNode(v.PROV_ACTIVITY)
    yield iri, v.PROV_ASSOCIATED_WITH, agent
    yield iri, v.PROV_QUALIFIED_ASSOCIATION, NamedNode(association)
    yield association, v.RDF_TYPE.value, NamedNode(v.PROV_ASSOCIATION)
    yield association, v.PROV_HAS_AGENT, agent
    yield from _of_program(base)


def _of_program(base: str) -> Iterator[_Fact]:
    yield base + PROGRAM, v.RDF_TYPE.value, NamedNode(v.PROV_AGENT)
    yield base + PROGRAM, v.RDF_TYPE.value, NamedNode(v.PROV_SOFTWARE_AGENT)
    yield base + PROGRAM, v.RDFS_LABEL, Literal("hereabouts")


def geometry_quads(
    base: str,
    objects: tuple[ObjectRecord, ...],
    places: tuple[PlaceRecord, ...],
    robot: RobotRecord | None,
) -> Iterator[Quad]:
    """geo:Feature, geo:hasGeometry and geo:asWKT of each record, and the reference system.

    The geometry of an object is its position; geo:hasBoundingBox is the footprint of its box.
    """
    crs = NamedNode(base + CRS)
    yield from crs_quads(base)
    for record in objects:
        yield from _geometry(record.iri, f"{crs} {_point(record.p_map)}")
        corners = record.footprint
        if corners is not None and np.isfinite(corners).all() and np.ptp(corners, axis=0).all():
            ring = tuple((round(float(x), 3), round(float(y), 3)) for x, y in corners)
            wkt = polygon_text((ring,), crs.value)
            yield from _shape(record.iri, v.GEO_HAS_BOUNDING_BOX, FOOTPRINT, wkt)
    for place in places:
        yield from _geometry(place.iri, polygon_text(place.area.rings, crs.value))
    if robot is not None:
        yield from _geometry(base + "robot", f"{crs} {_point(robot.p_map)}")


def crs_quads(base: str) -> Iterator[Quad]:
    """The coordinate reference system of the map with IRI `base`, which graph:dataset names."""
    comment = "Local frame of this map: metres, z up, the floor about z = 0; not geographic."
    texts = {v.RDFS_LABEL: "map frame", v.RDFS_COMMENT: comment}
    return _quads((base + CRS, predicate, Literal(text)) for predicate, text in texts.items())


def _geometry(iri: str, wkt: str) -> Iterator[Quad]:
    yield from _quads([(iri, v.RDF_TYPE.value, NamedNode(v.GEO_FEATURE))])
    yield from _shape(iri, v.GEO_HAS_GEOMETRY, GEOMETRY, wkt)


def _shape(iri: str, predicate: str, suffix: str, wkt: str) -> Iterator[Quad]:
    geometry = iri + suffix
    return _quads(
        [
            (iri, predicate, NamedNode(geometry)),
            (geometry, v.RDF_TYPE.value, NamedNode(v.GEO_GEOMETRY)),
            (geometry, v.GEO_AS_WKT, Literal(wkt, datatype=v.GEO_WKT_LITERAL)),
        ]
    )


def _point(p_map: object) -> str:
    x, y, z = (f"{float(value):.12g}" for value in p_map)  # type: ignore[attr-defined]
    return f"POINT Z ({x} {y} {z})"


def to_jsonld(triples: Iterable[Triple], prefixes: Mapping[str, str]) -> str:
    """A JSON-LD document with the triples in its default graph, in the order they come."""
    nodes: dict[str, dict[str, list[object]]] = {}
    for triple in triples:
        node = nodes.setdefault(_id(triple.subject, prefixes), {})
        if triple.predicate == v.RDF_TYPE and isinstance(triple.object, NamedNode):
            node.setdefault("@type", []).append(_id(triple.object, prefixes))
        else:
            key = _compact(triple.predicate.value, prefixes)
            node.setdefault(key, []).append(_value(triple.object, prefixes))
    graph = [
        {"@id": subject}
        | {key: values[0] if len(values) == 1 else values for key, values in node.items()}
        for subject, node in nodes.items()
    ]
    return json.dumps({"@context": dict(prefixes), "@graph": graph}, ensure_ascii=False, indent=1)


def _value(term: object, prefixes: Mapping[str, str]) -> object:
    if not isinstance(term, Literal):
        return {"@id": _id(term, prefixes)}
    if term.language:
        return {"@value": term.value, "@language": term.language}
    datatype = term.datatype.value
    if datatype == v.XSD + "string":
        return term.value
    number = whole_number(term.value) if datatype == v.XSD + "integer" else None
    if number is not None and term.value == str(number):
        return number
    return {"@value": term.value, "@type": _compact(datatype, prefixes)}


def _id(term: object, prefixes: Mapping[str, str]) -> str:
    if isinstance(term, BlankNode):
        return f"_:{term.value}"
    return _compact(term.value, prefixes) if isinstance(term, NamedNode) else str(term)


def _compact(iri: str, prefixes: Mapping[str, str]) -> str:
    matching = [(len(ns), name) for name, ns in prefixes.items() if iri.startswith(ns)]
    if not matching:
        return iri
    length, name = max(matching)
    local = iri[length:]
    # a prefixed name with // after the colon is an absolute IRI
    return iri if local.startswith("//") else f"{name}:{local}"
