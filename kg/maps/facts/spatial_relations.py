"""Facts of spatial relations: objects on, inside and beside others, and doors between places.

Each relation is a node with its probability. If the probability is at least 0.5, the relation is a
triple too (``?cup here:on ?table``). An object has at most one triple of on, and one of inside.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, cast
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import DoorRecord, Relation, RelationKind
from kg.rdf.literals import (
    Properties,
    first,
    iri_node,
    iri_order,
    known_iri,
    number_literal,
    properties_of,
)
from kg.rdf.quad_store import QuadStore

PREDICATES: Final[Mapping[RelationKind, str]] = {
    "on": v.ON,
    "inside": v.INSIDE,
    "beside": v.BESIDE,
}
#: An object has at most one relation of each of these kinds; people can assert them.
SINGLE: Final[tuple[RelationKind, ...]] = ("on", "inside")
NOTHING: Final = "nothing"  # asserted or perceived instead of an object
BELIEVED: Final = 0.5  # a relation of at least this probability is a triple of the object
#: Predicates of an object that state its relations, and those of their nodes.
OF_OBJECT: Final = frozenset((*PREDICATES.values(), v.HAS_RELATION))
OF_NODE: Final = frozenset((v.OF_RELATION, v.RELATED_TO, v.RELATION_PROBABILITY))

_KINDS: Final = {predicate: kind for kind, predicate in PREDICATES.items()}


def relation_quads(iri: str, relations: Iterable[Relation]) -> list[Quad]:
    """Facts of the relations of the object `iri`.

    Raises InvalidFactError for probabilities out of range, for a relation to itself, and for two
    relations of one kind to one object.
    """
    what, thing, relations = f"relation of {iri}", iri_node(iri, "object"), tuple(relations)
    quads = list[Quad]()
    for relation in relations:
        target = iri_node(relation.target, what)
        if target == thing:
            raise InvalidFactError(f"{what}: nothing is {relation.kind} itself")
        node = known_iri(node_of(iri, relation))
        probability = number_literal(relation.probability, what, minimum=0.0, maximum=1.0)
        quads += [
            Quad(thing, known_iri(v.HAS_RELATION), node, v.MAP_GRAPH),
            Quad(node, v.RDF_TYPE, known_iri(v.SPATIAL_RELATION), v.MAP_GRAPH),
            Quad(node, known_iri(v.OF_RELATION), known_iri(PREDICATES[relation.kind]), v.MAP_GRAPH),
            Quad(node, known_iri(v.RELATED_TO), target, v.MAP_GRAPH),
            Quad(node, known_iri(v.RELATION_PROBABILITY), probability, v.MAP_GRAPH),
        ]
    for relation in believed_relations(relations):
        predicate = known_iri(PREDICATES[relation.kind])
        quads.append(Quad(thing, predicate, iri_node(relation.target, what), v.MAP_GRAPH))
    if len(set(quads)) != len(quads):
        raise InvalidFactError(f"{what}: give each object once for each kind of relation")
    return quads


def believed_relations(relations: Iterable[Relation]) -> Iterator[Relation]:
    """Relations of probability 0.5 or above; of on and inside only the most probable one."""
    relations = tuple(relations)
    for kind in PREDICATES:
        found = [r for r in relations if r.kind == kind and round(r.probability, 2) >= BELIEVED]
        if kind in SINGLE:
            found = sorted(found, key=lambda r: (-r.probability, r.target))[:1]
        yield from found


def node_of(iri: str, relation: Relation) -> str:
    """IRI of the node of a relation of the object `iri`."""
    base, _, local = relation.target.rpartition("object/")
    name = local if base and iri.startswith(base) else relation.target
    return f"{iri}/relation/{relation.kind}/{quote(name, safe='')}"


def relation_nodes(store: QuadStore, iri: str) -> tuple[str, ...]:
    """IRIs of the nodes of all relations from and to an object."""
    thing = iri_node(iri, "object")
    own = store.quads_for_pattern(thing, NamedNode(v.HAS_RELATION), None, v.MAP_GRAPH)
    others = store.quads_for_pattern(None, NamedNode(v.RELATED_TO), thing, v.MAP_GRAPH)
    found = [*(quad.object for quad in own), *(quad.subject for quad in others)]
    return tuple(dict.fromkeys(n.value for n in found if isinstance(n, NamedNode)))


def relations_of(
    properties: Properties, subjects: Mapping[str, Properties]
) -> tuple[Relation, ...]:
    """Relations of an object with `properties`, whose nodes are among `subjects`."""
    found = list[Relation]()
    for iri in properties.get(v.HAS_RELATION, ()):
        node = subjects.get(iri, {})
        kind, target = _KINDS.get(first(node, v.OF_RELATION, "")), first(node, v.RELATED_TO, "")
        if kind is not None and target:
            probability = float(first(node, v.RELATION_PROBABILITY, "1"))
            found.append(Relation(kind, target, probability))
    return tuple(sorted(found, key=lambda r: (r.kind, -r.probability, iri_order(r.target))))


def asserted_relations(
    relations: Iterable[Relation], kind: str, target: str | None, probability: float
) -> tuple[Relation, ...]:
    """The relations with a single one of `kind` (on, inside), to `target`, unless "nothing"."""
    kept = tuple(relation for relation in relations if relation.kind != kind)
    if target in (None, NOTHING):
        return kept
    return (*kept, Relation(cast(RelationKind, kind), str(target), probability))


def perceived_value(relations: Iterable[Relation], kind: str) -> tuple[str, float]:
    """The most probable object of a relation (on, inside) or "nothing", and its probability."""
    found = [relation for relation in relations if relation.kind == kind]
    for relation in believed_relations(found):
        return relation.target, relation.probability
    return NOTHING, 1.0 - min(sum(relation.probability for relation in found), 1.0)


def facts_of_door(door: DoorRecord) -> list[Quad]:
    """Facts of a door.

    Raises InvalidFactError for numbers that are not finite, and unless it has two places.
    """
    what = f"door {door.iri}"
    if len(set(door.places)) != 2:
        raise InvalidFactError(f"{what}: a door is between two places, got {door.places}")
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, known_iri(v.DOOR)),
        (v.RDFS_LABEL, Literal("door " + door.iri.rstrip("/").rpartition("/")[2])),
        (v.X, number_literal(door.x, f"{what}: x")),
        (v.Y, number_literal(door.y, f"{what}: y")),
        (v.WIDTH, number_literal(door.width, f"{what}: width", minimum=0.0)),
        *((v.BOT_INTERFACE_OF, iri_node(place, f"{what}: place")) for place in door.places),
    ]
    if door.marked_by:
        facts.append((v.PROV_ATTRIBUTED_TO, iri_node(door.marked_by, f"{what}: author")))
    node = iri_node(door.iri, "door")
    return [Quad(node, known_iri(predicate), value, v.MAP_GRAPH) for predicate, value in facts]


def doors_in(engine: QuadStore) -> tuple[DoorRecord, ...]:
    """All doors between two places, by IRI; doors without a position are left out."""
    found = []
    for quad in engine.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.DOOR), v.MAP_GRAPH):
        properties = properties_of(engine, getattr(quad.subject, "value", ""), v.MAP_GRAPH)
        places = sorted(properties.get(v.BOT_INTERFACE_OF, ()), key=iri_order)
        if len(places) == 2 and v.X in properties and v.Y in properties:
            x, y, width = (float(first(properties, p, "0")) for p in (v.X, v.Y, v.WIDTH))
            iri = getattr(quad.subject, "value", "")
            author = first(properties, v.PROV_ATTRIBUTED_TO, "")
            found.append(DoorRecord(iri, x, y, width, (places[0], places[1]), author))
    return tuple(sorted(found, key=lambda door: iri_order(door.iri)))
