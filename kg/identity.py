"""Who a map is: its IRI, its title, and what it holds before its first transaction."""

from __future__ import annotations

import uuid

from pyoxigraph import Literal, NamedNode, Quad

from kg import vocabulary as v
from kg.blank_nodes import named
from kg.characters import shown
from kg.errors import GraphError, MapNotFoundError
from kg.ontology import compile_commonsense, load_ontologies
from kg.store import MapStore
from kg.times import now

MAPS = "https://w3id.org/hereabouts/maps/"

_DATASET = NamedNode(v.DATASET_GRAPH)
_TYPE = NamedNode(v.RDF_TYPE)


def first_quads(title: str, base: str | None) -> list[Quad]:
    """What a new map holds: the ontology, its compiled view, and who the map is."""
    node = _base_node(base)
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE, NamedNode(v.SEMANTIC_MAP)),
        (v.RDF_TYPE, NamedNode(v.VOID_DATASET)),
        (v.DCT_TITLE, Literal(shown(title))),
        (v.DCT_CREATED, now()),
        (v.NEXT_OBJECT, Literal(1)),
    ]
    identity = [Quad(node, NamedNode(predicate), value, _DATASET) for predicate, value in facts]
    ontology = named(load_ontologies().quads)
    return [*ontology, *compile_commonsense(ontology), *identity]


def _base_node(base: str | None) -> NamedNode:
    text = f"{MAPS}{uuid.uuid4()}/" if base is None else base
    try:
        return NamedNode(text if text.endswith(("/", "#")) else text + "/")
    except ValueError as error:
        raise GraphError(
            f"base must be an absolute IRI such as http://..., got {base!r}"
        ) from error


def _title(store: MapStore, subject: NamedNode) -> str:
    quads = store.engine.quads_for_pattern(subject, NamedNode(v.DCT_TITLE), None, _DATASET)
    return min((q.object.value for q in quads if isinstance(q.object, Literal)), default="map")


def identity(store: MapStore, base: str | None = None) -> tuple[str, str]:
    """IRI and title of the map in `store`, whose IRI may be known to be `base`.

    Raises MapNotFoundError where there is none.
    """
    if base is not None:
        return base, _title(store, NamedNode(base))
    kind = NamedNode(v.SEMANTIC_MAP)
    for quad in store.engine.quads_for_pattern(None, _TYPE, kind, _DATASET):
        if isinstance(quad.subject, NamedNode):
            return quad.subject.value, _title(store, quad.subject)
    raise MapNotFoundError(
        f"no map at {store.where}: its store says of no {v.SEMANTIC_MAP} who it is; create a map"
    )
