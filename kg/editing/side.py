"""One of two ontologies that are compared: its terms, names, parents and relations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Final

from pyoxigraph import Quad

from kg import vocabulary as v
from kg.blank_nodes import named
from kg.categories import Catalogue
from kg.relations import KINDS, relations

_DECLARATIONS: Final = {
    v.OWL_CLASS: "class",
    v.OWL_OBJECT_PROPERTY: "object property",
    v.OWL_DATATYPE_PROPERTY: "data property",
    v.OWL_ANNOTATION_PROPERTY: "annotation property",
    v.OWL_ONTOLOGY: "ontology",
}


class Side:
    """An ontology's quads, under names for its blank nodes, and what they say by term."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        """Raises OntologyError where relations are malformed (`kg.relations`)."""
        self.quads = named(quads)
        self.catalogue = Catalogue.from_quads(self.quads)
        self.relations = {(r.kind, r.subject, r.target): r for r in relations(self.quads)}
        self.terms: dict[str, str] = {}
        self.parents: dict[str, set[str]] = defaultdict(set)
        self.axioms: set[str] = set()  # nodes that annotate a relation
        self.statistics: dict[str, dict[str, str]] = {}  # of rooms: node -> property -> value
        self._labels: dict[str, str] = {}
        for quad in self.quads:
            self._note(quad)
        for quad in self.quads:
            if (said := self.statistics.get(getattr(quad.subject, "value", ""))) is not None:
                said[quad.predicate.value] = getattr(quad.object, "value", "")

    def _note(self, quad: Quad) -> None:
        subject, predicate = getattr(quad.subject, "value", ""), quad.predicate.value
        value = getattr(quad.object, "value", "")
        if predicate == v.RDFS_LABEL:
            self._labels[subject] = min(value, self._labels.get(subject, value))
        elif predicate == v.RDF_TYPE and value in _DECLARATIONS:
            if not subject.startswith(v.GENID):
                self.terms[subject] = _DECLARATIONS[value]
        elif predicate == v.RDF_TYPE and value == v.ROOM_STATISTICS:
            self.statistics[subject] = {}
        elif predicate == v.RDFS_SUB_CLASS_OF and not value.startswith(v.GENID):
            self.parents[subject].add(value)
        elif predicate == v.OWL_ANNOTATED_PROPERTY and value in KINDS:
            self.axioms.add(subject)

    def name(self, iri: str) -> str:
        """What people call a term."""
        category = self.catalogue.by_iri(iri)
        if category is not None:
            return category.label
        return self._labels.get(iri) or iri.replace(v.HERE, "here:")

    def counted(self, iri: str) -> str:
        """What statistics of rooms say, in words."""
        said = self.statistics[iri]
        thing, place = (
            self.name(said.get(one, "")) for one in (v.STATISTICS_OBJECT, v.STATISTICS_PLACE)
        )
        rooms, held = said.get(v.ROOM_COUNT, "?"), said.get(v.ROOMS_WITH_OBJECT, "?")
        return f"{thing} in {held} of {rooms} rooms that are {place} ({said.get(v.DCT_SOURCE)!r})"

    def kind(self, iri: str) -> str:
        """``category``, or what else the term is declared as."""
        return "category" if self.catalogue.by_iri(iri) else self.terms[iri]

    def above(self, iri: str) -> str:
        """The names of what a class stands directly under, as one text."""
        return " and ".join(sorted(self.name(parent) for parent in self.parents[iri]))

    def synonyms(self, iri: str) -> tuple[str, ...]:
        """What else a category is called."""
        category = self.catalogue.by_iri(iri)
        return category.synonyms if category else ()
