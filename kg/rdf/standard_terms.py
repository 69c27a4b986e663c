"""Derived triples in standard vocabularies: SSN/SOSA, PROV-O and OWL-Time.

They follow from stored triples, so the map does not store them: exports and the documents of
resources have them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from urllib.parse import quote, unquote

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.rdf.literals import Properties, first

_STAMP = NamedNode(v.XSD + "dateTimeStamp")
SENSOR = "sensor/"  # + the model's name, behind the map's IRI
PROGRAM = "agent/hereabouts"  # the agent of searches, behind the map's IRI

_Fact = tuple[str, str, NamedNode | Literal]


def standard_quads(base: str, subjects: Mapping[str, Properties]) -> Iterator[Quad]:
    """Triples derived from the observations and searches among `subjects`."""
    facts: dict[_Fact, None] = {}
    for iri, held in subjects.items():
        types = held.get(v.RDF_TYPE.value, ())
        if v.SOSA_OBSERVATION in types:
            facts.update(dict.fromkeys(_of_observation(base, iri, held)))
        if v.SEARCH in types:
            facts.update(dict.fromkeys(_of_search(base, iri)))
    for subject, predicate, value in facts:
        yield Quad(NamedNode(subject), NamedNode(predicate), value, v.MAP_GRAPH)


def sensor_quads(base: str, iri: str) -> Iterator[Quad]:
    """Type, label and observed property of a sensor: a detection network."""
    for subject, predicate, value in _of_sensor(iri, unquote(iri.removeprefix(base + SENSOR))):
        yield Quad(NamedNode(subject), NamedNode(predicate), value, v.MAP_GRAPH)


def program_quads(base: str) -> Iterator[Quad]:
    """Types and label of the agent that carries out searches."""
    for subject, predicate, value in _of_program(base):
        yield Quad(NamedNode(subject), NamedNode(predicate), value, v.MAP_GRAPH)


def _of_observation(base: str, iri: str, held: Properties) -> Iterator[_Fact]:
    """SOSA, sections 4.3 and 4.5: by which sensor, of what, with what result, about when."""
    model, score = first(held, v.MODEL, ""), first(held, v.SCORE, "")
    stamp = first(held, v.SOSA_RESULT_TIME, "")
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
    """PROV-O, section 3.3: an activity, and the agent it is qualifiedly associated with."""
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
