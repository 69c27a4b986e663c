"""Doors between places (bot:Interface of two zones): records to quads of graph:map, and back."""

from __future__ import annotations

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import DoorRecord
from kg.rdf.literals import first, iri_node, iri_order, known_iri, number_literal, properties_of
from kg.rdf.quad_store import QuadStore


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
