"""Metadata of a map: its IRI, title and licence, and its quads before the first transaction."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import CompiledOntology, shipped_ontology
from kg.maps.facts.coordinate_frames import frame_quads, maps_in
from kg.model import vocabulary as v
from kg.model.errors import GraphError, InvalidFactError, MapNotFoundError
from kg.rdf.literals import first, now, properties_of, shown
from kg.rdf.quad_store import QuadStore
from kg.store.transactional import TransactionalStore

MAPS = "https://w3id.org/hereabouts/maps/"


def first_quads(
    title: str, base: str | None, ontology: CompiledOntology | None = None
) -> list[Quad]:
    """Quads of a new map: the (shipped) ontology, its compiled view, and the map's metadata."""
    node = _base_node(base)
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, NamedNode(v.SEMANTIC_MAP)),
        (v.RDF_TYPE.value, NamedNode(v.VOID_DATASET)),
        (v.DCT_TITLE, Literal(shown(title))),
        (v.DCT_CREATED, now()),
        (v.NEXT_OBJECT, Literal(1)),
    ]
    identity = [
        Quad(node, NamedNode(predicate), value, v.DATASET_GRAPH) for predicate, value in facts
    ]
    ontology = ontology or shipped_ontology()
    return [*ontology.quads, *identity, *frame_quads(node.value)]


def _base_node(base: str | None) -> NamedNode:
    text = f"{MAPS}{uuid.uuid4()}/" if base is None else base
    try:
        return NamedNode(text if text.endswith(("/", "#")) else text + "/")
    except ValueError as error:
        raise GraphError(
            f"base must be an absolute IRI such as http://..., got {base!r}"
        ) from error


@dataclass(frozen=True, slots=True)
class Description:
    """Metadata of a map (graph:dataset): `created` is ISO 8601, `licence` an IRI or None."""

    iri: str
    title: str
    created: str
    licence: str | None


def description_of(engine: QuadStore, base: str) -> Description:
    """The metadata of the map with IRI `base`."""
    properties = properties_of(engine, base, v.DATASET_GRAPH)
    title = min(properties.get(v.DCT_TITLE, ()), default="map")
    licence = min(properties.get(v.DCT_LICENSE, ()), default=None)
    return Description(base, title, first(properties, v.DCT_CREATED, ""), licence)


def changed_description(
    engine: QuadStore, base: str, title: str | None, licence: str | None
) -> tuple[list[Quad], list[Quad]]:
    """Quads to delete and to insert for a new title or licence (None: unchanged).

    Raises InvalidFactError for an empty title, and for a licence that is not an absolute IRI.
    """
    node = NamedNode(base)
    added = [
        Quad(node, NamedNode(predicate), value, v.DATASET_GRAPH)
        for predicate, value in _checked(title, licence)
    ]
    removed = [
        quad
        for new in added
        for quad in engine.quads_for_pattern(node, new.predicate, None, v.DATASET_GRAPH)
    ]
    return [q for q in removed if q not in added], [q for q in added if q not in removed]


def _checked(title: str | None, licence: str | None) -> Iterator[tuple[str, Literal | NamedNode]]:
    if title is not None:
        if not title.strip():
            raise InvalidFactError("a map's title needs at least one letter")
        yield v.DCT_TITLE, Literal(shown(title))
    if licence is not None:
        try:
            yield v.DCT_LICENSE, NamedNode(licence)
        except ValueError as error:
            raise InvalidFactError(
                f"a licence is an absolute IRI such as {v.LICENSES}by/4.0/, got {licence!r}"
            ) from error


def identity(store: TransactionalStore) -> str:
    """IRI of the map in `store`, of several the first; raises MapNotFoundError where none is."""
    if maps := maps_in(store.engine):
        return maps[0]
    raise MapNotFoundError(
        f"no map at {store.where}: its store describes no {v.SEMANTIC_MAP}; create a map"
    )
