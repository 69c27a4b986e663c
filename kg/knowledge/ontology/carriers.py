"""Kinds of objects that carry or contain others, from here:carries in the ontology."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pyoxigraph import NamedNode, Quad

from kg.knowledge.ontology.loading import superclasses
from kg.model import vocabulary as v


@dataclass(frozen=True, slots=True)
class CarrierKinds:
    """IRIs of categories that objects may be on or inside of, subclasses included."""

    supports: frozenset[str]
    containers: frozenset[str]
    backs: Mapping[str, float]  # [m] usual height of backrest or headboard over the surface


def carrier_kinds(ontology: Iterable[Quad]) -> CarrierKinds:
    """The carriers declared in an ontology's quads."""
    ontology = tuple(ontology)
    carried: dict[str, set[str]] = {v.ON: set(), v.INSIDE: set()}
    backs: dict[str, float] = {}
    for quad in ontology:
        value = str(getattr(quad.object, "value", ""))
        if not isinstance(quad.subject, NamedNode):
            continue
        if quad.predicate.value == v.CARRIES and value in carried:
            carried[value].add(quad.subject.value)
        elif quad.predicate.value == v.BACK_HEIGHT:
            backs[quad.subject.value] = float(value)
    above = superclasses(ontology)
    return CarrierKinds(
        frozenset(iri for iri, kinds in above.items() if carried[v.ON] & {*kinds}),
        frozenset(iri for iri, kinds in above.items() if carried[v.INSIDE] & {*kinds}),
        {
            iri: max(backs[kind] for kind in kinds if kind in backs)
            for iri, kinds in above.items()
            if any(kind in backs for kind in kinds)
        },
    )
