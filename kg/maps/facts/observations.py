"""Sightings of things and places, as facts and back: best observation, classes, views.

An object has a best observation (sosa:Observation) and alternative classes, each a node with a
probability: that a thing of that class is there, as `here:existence` is for the object's own class.
The probabilities of all classes and of no object at all add up to 1. Views of a place are the
viewed share of its floor and the time of the last view.

A departed object has its former position, the times of its views, and the time when it was found
gone. The subject is its own IRI, so that an object that is found elsewhere, even after a restart,
keeps its identity. The class is not a category of the ontology, so readers of objects
ignore departed ones.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.facts.robot import recording_iri, recording_name
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.iris import observation_iri
from kg.model.records import DepartedRecord, Evidence, PlaceViews
from kg.rdf.literals import (
    AXES,
    SIDES,
    Properties,
    axes_of,
    axis_literals,
    first,
    iri_node,
    iri_order,
    known_iri,
    number_literal,
    properties_of,
    quantised,
    share_literal,
    stamp_of,
    subject_quads,
    time_literal,
    yaw_literals,
)
from kg.rdf.quad_store import QuadStore
from kg.store.sparql_backend import reading_ahead


def observation_quads(iri: str, evidence: Evidence, base: str) -> list[Quad]:
    """Facts of the observation of the object `iri`.

    Raises InvalidFactError for numbers that are not finite or out of range.
    """
    what = f"observation of {iri}"
    if len(evidence.box) != 4 or not all(map(math.isfinite, evidence.box)):
        raise InvalidFactError(f"{what}: box must be 4 finite numbers, got {evidence.box}")
    return subject_quads(
        observation_iri(base, iri),
        [
            (v.RDF_TYPE.value, known_iri(v.SOSA_OBSERVATION)),
            (v.SOSA_FEATURE, iri_node(iri, what)),
            (v.SOSA_RESULT_TIME, time_literal(evidence.stamp, f"{what}: stamp")),
            (v.FRAME, Literal(evidence.frame)),
            (v.FROM_RECORDING, known_iri(recording_iri(evidence.recording, base))),
            (v.BOX, Literal(" ".join(str(round(n)) for n in evidence.box))),
            (v.SCORE, share_literal(evidence.score, f"{what}: score")),
            (v.MODEL, Literal(evidence.model)),
        ],
    )


def evidence_of(properties: Properties, base: str) -> Evidence:
    """The evidence that an observation with `properties` has."""
    left, top, right, bottom = (float(n) for n in first(properties, v.BOX, "0 0 0 0").split())
    return Evidence(
        frame=first(properties, v.FRAME, ""),
        recording=recording_name(first(properties, v.FROM_RECORDING, ""), base),
        stamp=stamp_of(properties, v.SOSA_RESULT_TIME),
        box=(left, top, right, bottom),
        score=float(first(properties, v.SCORE, "1")),
        model=first(properties, v.MODEL, ""),
    )


STEP: Final = 0.05  # of quantised probabilities; less probable alternatives are not stored
MAX_ALTERNATIVES: Final = 3  # alternatives of one object

_HAS: Final = NamedNode(v.HAS_LABEL_BELIEF)


def label_quads(iri: str, labels: Mapping[str, float]) -> list[Quad]:
    """Facts of the alternatives of the object `iri`, which are categories of objects.

    The most probable ones are stored, from 0.05 on. Raises InvalidFactError for probabilities that
    are not finite or out of range.
    """
    what, thing = f"label belief of {iri}", iri_node(iri, "object")
    quads = list[Quad]()
    for category, probability in stored_labels(labels, what).items():
        node = known_iri(f"{iri}/label/{quote(category.removeprefix(v.HERE), safe='')}")
        quads += [
            Quad(thing, _HAS, node, v.MAP_GRAPH),
            Quad(node, v.RDF_TYPE, known_iri(v.LABEL_BELIEF), v.MAP_GRAPH),
            Quad(node, known_iri(v.OF_CATEGORY), iri_node(category, what), v.MAP_GRAPH),
            Quad(node, known_iri(v.LABEL_PROBABILITY), Literal(probability), v.MAP_GRAPH),
        ]
    return quads


def stored_labels(labels: Mapping[str, float], what: str) -> dict[str, float]:
    """Alternatives as they are stored: quantised, the most probable ones first."""
    for probability in labels.values():
        number_literal(probability, what, minimum=0.0, maximum=1.0)
    steps = {category: quantised(p / STEP, what, 0) * STEP for category, p in labels.items()}
    likely = sorted(labels, key=lambda category: (-labels[category], category))[:MAX_ALTERNATIVES]
    return {c: round(steps[c], 2) for c in likely if labels[c] >= STEP}


def label_nodes(store: QuadStore, iri: str) -> Iterator[NamedNode]:
    """Nodes of an object's alternatives."""
    for quad in store.quads_for_pattern(iri_node(iri, "object"), _HAS, None, v.MAP_GRAPH):
        if isinstance(quad.object, NamedNode):
            yield quad.object


def labels_of(properties: Properties, subjects: Mapping[str, Properties]) -> dict[str, float]:
    """Alternatives of an object with `properties`, whose nodes are among `subjects`."""
    found = dict[str, float]()
    for iri in properties.get(v.HAS_LABEL_BELIEF, ()):
        node = subjects.get(iri, {})
        if v.OF_CATEGORY in node and v.LABEL_PROBABILITY in node:
            found[first(node, v.OF_CATEGORY, "")] = float(first(node, v.LABEL_PROBABILITY, "0"))
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


def facts_of_views(viewed: PlaceViews | None, what: str) -> Iterator[tuple[str, Literal]]:
    """Predicates and values; raises InvalidFactError, which names `what`, for invalid shares."""
    if viewed is None:
        return
    if not 0 <= viewed.close_share <= viewed.share <= 1:
        raise InvalidFactError(
            f"{what}: shares viewed must lie between 0 and 1, got {viewed.share:g} and, from close "
            f"by, {viewed.close_share:g}"
        )
    yield v.VIEWED_SHARE, number_literal(viewed.share, f"{what}: share viewed")
    yield v.CLOSELY_VIEWED_SHARE, number_literal(viewed.close_share, f"{what}: share viewed")
    yield v.LAST_VIEWED, time_literal(viewed.last, f"{what}: last viewed")


def views_of(properties: Properties) -> PlaceViews | None:
    """The views that a place's properties state; None without them."""
    if v.VIEWED_SHARE not in properties or v.LAST_VIEWED not in properties:
        return None
    share = float(first(properties, v.VIEWED_SHARE, "0"))
    close = float(first(properties, v.CLOSELY_VIEWED_SHARE, "0"))
    return PlaceViews(share, min(close, share), stamp_of(properties, v.LAST_VIEWED))


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
