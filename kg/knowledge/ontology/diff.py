"""Ontology diff: changes of terms, relations and names, and counts of other statements by term."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.relations import KINDS, CategoryRelation, relations
from kg.model import vocabulary as v
from kg.rdf.skolem import named, with_names

_DECLARATIONS: Final = {
    v.OWL_CLASS: "class",
    v.OWL_OBJECT_PROPERTY: "object property",
    v.OWL_DATATYPE_PROPERTY: "data property",
    v.OWL_ANNOTATION_PROPERTY: "annotation property",
    v.OWL_ONTOLOGY: "ontology",
}


class OntologySummary:
    """Summary of an ontology: its skolemised quads, and its properties by term."""

    def __init__(self, quads: tuple[Quad, ...]) -> None:
        """Raises OntologyError for malformed relations (`kg.knowledge.ontology.relations`)."""
        self.quads = quads
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


_NAMING: Final = {
    v.RDFS_LABEL: "label",
    v.SKOS_ALT_LABEL: "synonym",
    v.RDFS_COMMENT: "comment",
    v.OWL_VERSION_INFO: "version",
}
_OF_AXIOMS: Final = {
    v.RDF_TYPE.value,
    v.PROBABILITY,
    v.DCT_SOURCE,
    v.OWL_ANNOTATED_SOURCE,
    v.OWL_ANNOTATED_PROPERTY,
    v.OWL_ANNOTATED_TARGET,
}
_VERBS: Final = {v.LOCATED_AT: "located at", v.NEAR_BY: "near"}


@dataclass(frozen=True, slots=True)
class OntologyChange:
    """One difference: added (+), removed (-) or changed (~)."""

    sign: str
    #: rename, term, relation, probability, source, label, synonym, comment, version, parent,
    #: statistics or other
    kind: str
    subject: str  # IRI of the changed term
    words: str
    before: str = ""
    after: str = ""

    def __str__(self) -> str:
        return f"{self.sign} {self.words}"


def changes(old: Iterable[Quad], new: Iterable[Quad]) -> list[OntologyChange]:
    """As `changes_of_named`, of any quads."""
    return changes_of_named(named(old), named(new))


def changes_of_named(old: tuple[Quad, ...], new: tuple[Quad, ...]) -> list[OntologyChange]:
    """Changes between two ontologies, as skolemised quads: terms, relations, names, others.

    A term with a new IRI and its old labels is renamed; what other statements say of it is then no
    change.
    Raises OntologyError for malformed relations (`kg.knowledge.ontology.relations`).
    """
    renamed = renamed_terms(old, new)
    before, after = OntologySummary(_with_iris(old, renamed)), OntologySummary(new)
    old_quads, new_quads = set(before.quads), set(after.quads)
    removed = [q for q in before.quads if q not in new_quads]
    added = [q for q in after.quads if q not in old_quads]
    return [
        *(_rename(iri, other, after) for iri, other in sorted(renamed.items())),
        *_terms(before, after),
        *_relations(before, after),
        *_names(before, after, removed, added),
        *_parents(before, after),
        *_statistics(before, after, removed, added),
        *_others(before, after, removed, added),
    ]


def renamed_terms(old: Iterable[Quad], new: Iterable[Quad]) -> dict[str, str]:
    """New IRI by old IRI of the terms that have another IRI and the labels and kinds as before.

    Terms that share their labels with others are not paired.
    """
    before, after = _labelled(old), _labelled(new)
    pairs: dict[frozenset[object], tuple[list[str], list[str]]] = defaultdict(lambda: ([], []))
    for iri in before.keys() - after.keys():
        pairs[frozenset(before[iri])][0].append(iri)
    for iri in after.keys() - before.keys():
        pairs[frozenset(after[iri])][1].append(iri)
    return {gone[0]: come[0] for gone, come in pairs.values() if len(gone) == len(come) == 1}


def _labelled(quads: Iterable[Quad]) -> dict[str, set[object]]:
    """The kinds and labels of each named term that has a label, but for ontologies."""
    found: dict[str, set[object]] = defaultdict(set)
    for q in quads:
        if q.predicate.value in (v.RDFS_LABEL, v.RDF_TYPE.value) and isinstance(
            q.subject, NamedNode
        ):
            found[q.subject.value].add(q.object)
    headers = NamedNode(v.OWL_ONTOLOGY)
    return {
        iri: said
        for iri, said in found.items()
        if headers not in said and any(isinstance(term, Literal) for term in said)
    }


def _with_iris(quads: tuple[Quad, ...], iris: Mapping[str, str]) -> tuple[Quad, ...]:
    """The quads with other IRIs for some terms; nodes that stood for axioms about them anew."""
    if not iris:
        return quads
    nodes: dict[object, NamedNode] = {
        NamedNode(iri): NamedNode(other) for iri, other in iris.items()
    }
    return named(with_names(quads, nodes))


def _rename(iri: str, other: str, after: OntologySummary) -> OntologyChange:
    short, new = (one.replace(v.HERE, "here:") for one in (iri, other))
    words = f"{after.kind(other)} {after.name(other)!r} renamed from {short} to {new}"
    return OntologyChange("~", "rename", other, words, iri, other)


def _terms(before: OntologySummary, after: OntologySummary) -> Iterator[OntologyChange]:
    for iri in _files_last(after.terms.keys() - before.terms.keys(), after):
        name = after.name(iri)
        under = f" under {above}" if (above := after.above(iri)) else ""
        also = ", ".join(repr(name) for name in after.synonyms(iri))
        called = f", also called {also}" if also else ""
        words = f"{after.kind(iri)} {name!r} added{under}{called}"
        yield OntologyChange("+", "term", iri, words, after=name)
    for iri in _files_last(before.terms.keys() - after.terms.keys(), before):
        name = before.name(iri)
        yield OntologyChange("-", "term", iri, f"{before.kind(iri)} {name!r} removed", before=name)


def _files_last(iris: Iterable[str], side: OntologySummary) -> list[str]:
    return sorted(iris, key=lambda iri: (side.terms[iri] == "ontology", iri))


def _relations(before: OntologySummary, after: OntologySummary) -> Iterator[OntologyChange]:
    for key in sorted(before.relations.keys() | after.relations.keys()):
        old, new = before.relations.get(key), after.relations.get(key)
        if old is None and new is not None:
            sources = f" ({listed})" if (listed := _listed(new)) else ""
            words = f"{_stated(new, after)} {new.probability:g} added{sources}"
            yield OntologyChange("+", "relation", key[1], words, after=f"{new.probability:g}")
        elif new is None and old is not None:
            words = f"{_stated(old, before)} {old.probability:g} removed"
            yield OntologyChange("-", "relation", key[1], words, before=f"{old.probability:g}")
        elif old is not None and new is not None:
            yield from _restated(old, new, after)


def _restated(
    old: CategoryRelation, new: CategoryRelation, side: OntologySummary
) -> Iterator[OntologyChange]:
    what = _stated(new, side)
    if old.probability != new.probability:
        was, is_ = f"{old.probability:g}", f"{new.probability:g}"
        words = f"probability of {what} changed from {was} to {is_}"
        yield OntologyChange("~", "probability", new.subject, words, was, is_)
    if old.sources != new.sources:
        was, is_ = _listed(old), _listed(new)
        words = f"source of {what} changed from {was or 'none'} to {is_ or 'none'}"
        yield OntologyChange("~", "source", new.subject, words, was, is_)


def _stated(relation: CategoryRelation, side: OntologySummary) -> str:
    verb = _VERBS[relation.kind]
    return f"{side.name(relation.subject)} {verb} {side.name(relation.target)}"


def _listed(relation: CategoryRelation) -> str:
    return ", ".join(repr(getattr(source, "value", source)) for source in relation.sources)


def _names(
    before: OntologySummary, after: OntologySummary, removed: Iterable[Quad], added: Iterable[Quad]
) -> Iterator[OntologyChange]:
    """Labels, synonyms, comments and versions of the common terms."""
    both = before.terms.keys() & after.terms.keys()
    sides: dict[tuple[str, str], tuple[list[str], list[str]]] = defaultdict(lambda: ([], []))
    for index, quads in enumerate((removed, added)):
        for quad in quads:
            subject = getattr(quad.subject, "value", "")
            if quad.predicate.value in _NAMING and subject in both:
                sides[subject, quad.predicate.value][index].append(_literal_text(quad.object))
    for (iri, predicate), (old, new) in sorted(sides.items()):
        yield from _renamed(iri, _NAMING[predicate], before.name(iri), sorted(old), sorted(new))


def _renamed(
    iri: str, kind: str, of: str, old: list[str], new: list[str]
) -> Iterator[OntologyChange]:
    if kind != "synonym" and len(old) == len(new) == 1:
        words = f"{kind} of {of} changed from {old[0]} to {new[0]}"
        yield OntologyChange("~", kind, iri, words, old[0], new[0])
        return
    for text in old:
        yield OntologyChange("-", kind, iri, f"{kind} {text} of {of} removed", before=text)
    for text in new:
        yield OntologyChange("+", kind, iri, f"{kind} {text} of {of} added", after=text)


def _literal_text(term: object) -> str:
    if isinstance(term, Literal):
        return repr(term.value) + (f" ({term.language})" if term.language else "")
    return str(term)


def _parents(before: OntologySummary, after: OntologySummary) -> Iterator[OntologyChange]:
    for iri in sorted(before.terms.keys() & after.terms.keys()):
        was, is_ = before.above(iri), after.above(iri)
        if before.parents[iri] != after.parents[iri]:
            words = f"{after.name(iri)} moved from under {was or 'nothing'} to {is_ or 'nothing'}"
            yield OntologyChange("~", "parent", iri, words, was, is_)


def _statistics(
    before: OntologySummary, after: OntologySummary, removed: Iterable[Quad], added: Iterable[Quad]
) -> Iterator[OntologyChange]:
    """Room statistics; changed numbers are reported as removed and added."""
    sides = ("-", "removed", before, removed), ("+", "added", after, added)
    for sign, verb, side, quads in sides:
        touched = {getattr(quad.subject, "value", "") for quad in quads}
        for iri in sorted(touched & side.statistics.keys()):
            yield OntologyChange(sign, "statistics", iri, f"{side.counted(iri)} {verb}")


def _others(
    before: OntologySummary, after: OntologySummary, removed: Iterable[Quad], added: Iterable[Quad]
) -> Iterator[OntologyChange]:
    """Statements that no other change reports, counted by their term."""
    both = before.terms.keys() & after.terms.keys()
    for sign, side, quads in (("-", before, removed), ("+", after, added)):
        reported = side.terms.keys() - both
        counts = Counter(
            getattr(quad.subject, "value", "")
            for quad in quads
            if not _is_reported(quad, side, reported)
        )
        axioms = sum(counts.pop(iri) for iri in [*counts] if iri.startswith(v.GENID))
        verb = "added" if sign == "+" else "removed"
        for iri, count in sorted(counts.items()):
            words = f"{_counted(count, 'other statement')} about {side.name(iri)} {verb}"
            yield OntologyChange(sign, "other", iri, words)
        if axioms:
            words = f"{_counted(axioms, 'statement')} within axioms {verb}"
            yield OntologyChange(sign, "other", "", words)


def _is_reported(quad: Quad, side: OntologySummary, reported: Iterable[str]) -> bool:
    subject, predicate = getattr(quad.subject, "value", ""), quad.predicate.value
    if subject in side.statistics:
        return True
    if subject in reported or (predicate in KINDS and subject in side.terms):
        return True
    if subject in side.axioms:
        return predicate in _OF_AXIOMS
    if subject not in side.terms:
        return False
    to_node = getattr(quad.object, "value", "").startswith(v.GENID)
    return predicate in _NAMING or (predicate == v.RDFS_SUB_CLASS_OF and not to_node)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
