"""Ontology summary, one side of a diff: terms, names, parents and relations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Final

from pyoxigraph import Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.relations import KINDS, relations
from kg.model import vocabulary as v
from kg.rdf.skolem import named

_DECLARATIONS: Final = {
    v.OWL_CLASS: "class",
    v.OWL_OBJECT_PROPERTY: "object property",
    v.OWL_DATATYPE_PROPERTY: "data property",
    v.OWL_ANNOTATION_PROPERTY: "annotation property",
    v.OWL_ONTOLOGY: "ontology",
}


class OntologySummary:
    """Summary of an ontology: its skolemised quads, and its properties by term."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        """Raises OntologyError for malformed relations (`kg.knowledge.ontology.relations`)."""
        self.quads = named(quads)
        self.catalogue = Catalogue.from_quads(self.quads)
        self.relations = {(r.kind, r.subject, r.target): r for r in relations(self.quads)}
        self.terms: dict[str, str] = {}
        self.parents: dict[str, set[str]] = defaultdict(set)
        self.axioms: set[str] = set()  # nodes that annotate a relation
        self.statistics: dict[str, dict[str, str]] = {}  # of rooms: node -> property -> value
        self._labels: dict[str, str] = {}
        for quad in self.quads:
            self._add(quad)
        for quad in self.quads:
            if (properties := self.statistics.get(getattr(quad.subject, "value", ""))) is not None:
                properties[quad.predicate.value] = getattr(quad.object, "value", "")

    def _add(self, quad: Quad) -> None:
        subject, predicate = getattr(quad.subject, "value", ""), quad.predicate.value
        value = getattr(quad.object, "value", "")
        if predicate == v.RDFS_LABEL:
            self._labels[subject] = min(value, self._labels.get(subject, value))
        elif predicate == v.RDF_TYPE.value and value in _DECLARATIONS:
            if not subject.startswith(v.GENID):
                self.terms[subject] = _DECLARATIONS[value]
        elif predicate == v.RDF_TYPE.value and value == v.ROOM_STATISTICS:
            self.statistics[subject] = {}
        elif predicate == v.RDFS_SUB_CLASS_OF and not value.startswith(v.GENID):
            self.parents[subject].add(value)
        elif predicate == v.OWL_ANNOTATED_PROPERTY and value in KINDS:
            self.axioms.add(subject)

    def name(self, iri: str) -> str:
        """Label of a term."""
        category = self.catalogue.by_iri(iri)
        if category is not None:
            return category.label
        return self._labels.get(iri) or iri.replace(v.HERE, "here:")

    def counted(self, iri: str) -> str:
        """Room statistics as a phrase."""
        properties = self.statistics[iri]
        thing, place = (
            self.name(properties.get(one, "")) for one in (v.STATISTICS_OBJECT, v.STATISTICS_PLACE)
        )
        rooms, with_it = (properties.get(one, "?") for one in (v.ROOM_COUNT, v.ROOMS_WITH_OBJECT))
        source = properties.get(v.DCT_SOURCE)
        return f"{thing} in {with_it} of {rooms} rooms that are {place} ({source!r})"

    def kind(self, iri: str) -> str:
        """``category``, or the declared kind of another term."""
        return "category" if self.catalogue.by_iri(iri) else self.terms[iri]

    def above(self, iri: str) -> str:
        """Labels of the direct superclasses of a class, as one text."""
        return " and ".join(sorted(self.name(parent) for parent in self.parents[iri]))

    def synonyms(self, iri: str) -> tuple[str, ...]:
        """Synonyms of a category."""
        category = self.catalogue.by_iri(iri)
        return category.synonyms if category else ()
