"""Facts of departed objects: former position, times of views, time when found gone.

The subject is the object's own IRI, so that an object that is found elsewhere, even after a
restart, keeps its identity. The class is not a category of the ontology, so readers of objects
ignore departed ones.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import DepartedRecord
from kg.rdf.literals import (
    AXES,
    SIDES,
    Properties,
    axes_of,
    axis_literals,
    first,
    iri_node,
    iri_order,
    properties_of,
    share_literal,
    stamp_of,
    subject_quads,
    time_literal,
    yaw_literals,
)
from kg.rdf.quad_store import QuadStore
from kg.store.sparql_backend import reading_ahead

_DEPARTED: Final = NamedNode(v.DEPARTED_OBJECT)


def departed_quads(record: DepartedRecord) -> list[Quad]:
    """Facts of a departed object, except its label.

    Raises InvalidFactError for numbers that are not finite or out of range.
    """
    what = f"departed object {record.iri}"
    if record.observations < 1:
        raise InvalidFactError(f"{what}: observations must be 1 or more, got {record.observations}")
    if not record.first_seen <= record.last_seen <= record.found_gone:
        raise InvalidFactError(
            f"{what}: first seen, last seen and found gone must be in this order"
        )
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, _DEPARTED),
        (v.OF_CATEGORY, iri_node(record.category, what)),
        (v.PEAK_EXISTENCE, share_literal(record.peak, f"{what}: peak")),
        (v.OBSERVATION_COUNT, Literal(record.observations)),
        (v.FIRST_SEEN, time_literal(record.first_seen, f"{what}: first seen")),
        (v.LAST_SEEN, time_literal(record.last_seen, f"{what}: last seen")),
        (v.FOUND_GONE, time_literal(record.found_gone, f"{what}: found gone")),
        *axis_literals(AXES, record.p_map, f"{what}: position"),
    ]
    if record.extent is not None:
        facts += axis_literals(SIDES, record.extent, f"{what}: extent", minimum=0.0)
        facts += yaw_literals(record.yaw, what)
    return subject_quads(record.iri, facts)


def departed_in(store: QuadStore, iris: Collection[str] | None = None) -> list[DepartedRecord]:
    """Departed objects, all or only `iris`, by the time when they were found gone."""
    if iris is None:
        quads = store.quads_for_pattern(None, v.RDF_TYPE, _DEPARTED, v.MAP_GRAPH)
        nodes = [quad.subject for quad in quads if isinstance(quad.subject, NamedNode)]
    else:
        nodes = [iri_node(iri, "object") for iri in iris]
    found = list[DepartedRecord]()
    with reading_ahead(store, nodes):
        for node in nodes:
            properties = properties_of(store, node.value, v.MAP_GRAPH)
            is_departed = v.DEPARTED_OBJECT in properties.get(v.RDF_TYPE.value, ())
            if is_departed and {v.OF_CATEGORY, v.X, v.Y} <= properties.keys():
                found.append(_record(node.value, properties))
    return sorted(found, key=lambda record: (record.found_gone, iri_order(record.iri)))


def _record(iri: str, properties: Properties) -> DepartedRecord:
    return DepartedRecord(
        iri=iri,
        category=first(properties, v.OF_CATEGORY, ""),
        p_map=axes_of(properties, AXES),
        peak=float(first(properties, v.PEAK_EXISTENCE, "1")),
        observations=int(first(properties, v.OBSERVATION_COUNT, "1")),
        first_seen=stamp_of(properties, v.FIRST_SEEN),
        last_seen=stamp_of(properties, v.LAST_SEEN),
        found_gone=stamp_of(properties, v.FOUND_GONE),
        extent=axes_of(properties, SIDES) if properties.keys() >= set(SIDES) else None,
        yaw=float(first(properties, v.YAW, "0")),
    )
