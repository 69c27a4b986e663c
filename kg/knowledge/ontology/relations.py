"""Commonsense relations: annotated relations between classes of an ontology.

`here:Banana here:locatedAt here:Kitchen` is an annotation between two classes, its probability and
source are annotations on that statement, an owl:Axiom node: what Protege shows and edits.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.import_digest import as_imported
from kg.model import vocabulary as v
from kg.model.errors import OntologyError

#: The properties that relate classes.
KINDS: Final = (v.LOCATED_AT, v.NEAR_BY)

_Notes = list[tuple[str, object]]
_Key = tuple[str, str, str]  # property, subject, target


@dataclass(frozen=True, slots=True)
class RelationEvidence:
    """Evidence of one source: an owl:Axiom node of an importer, or all statements of people."""

    probability: float  # 0..1
    sources: tuple[str | Literal, ...] = ()  # an IRI, or a literal as in the ontology
    weight: float | None = None  # the source's own measure of how well supported it is; >= 0
    weight_against: float = 0.0  # the same, of the evidence against it
    stated: bool = True  # by a person (or an importer's, edited since), not as imported

    @property
    def imported(self) -> bool:
        """Whether it is unchanged since the import."""
        return self.weight is not None and not self.stated


@dataclass(frozen=True, slots=True)
class Relation:
    """One edge of common sense: things of class `subject` are found at, or near, `target`.

    `probability` is what people state; where they state nothing, the highest imported one.
    `sources` are those of the evidence with that probability.
    """

    kind: str  # IRI: here:locatedAt or here:nearBy
    subject: str  # IRI of a class
    target: str  # IRI of a class
    probability: float  # 0..1
    sources: tuple[str | Literal, ...] = ()
    evidence: tuple[RelationEvidence, ...] = ()  # one or more; what people state first

    @property
    def iri(self) -> str:
        """The IRI of its node in graph:commonsense."""
        return f"{v.RELATION}{_name(self.kind)}/{_name(self.subject)}/{_name(self.target)}"


def _name(iri: str) -> str:
    return iri.removeprefix(v.HERE) if iri.startswith(v.HERE) else quote(iri, safe="")


def relations(quads: Iterable[Quad]) -> tuple[Relation, ...]:
    """The relations between classes, each with the evidence annotated on it.

    An owl:Axiom node that is as its importer left it (`kg.knowledge.ontology.import_digest`) is
    evidence of its own; all
    other nodes of a relation are what people state, together. A relation nobody annotated takes
    the probability of its property (``here:locatedAt here:probability 0.2e0``).

    Raises:
        OntologyError: what people state, or an import, has no probability, two, or one that is
            not in 0..1; or a weight that is not a number of at least 0.
    """
    stated: set[_Key] = set()
    notes: dict[object, _Notes] = defaultdict(list)
    for q in quads:
        notes[q.subject].append((q.predicate.value, q.object))
        if (
            q.predicate.value in KINDS
            and isinstance(q.subject, NamedNode)
            and isinstance(q.object, NamedNode)
        ):
            stated.add((q.predicate.value, q.subject.value, q.object.value))
    annotated = _annotations(notes)
    defaults = {kind: notes[NamedNode(kind)] for kind in KINDS}
    return tuple(_relation(key, annotated[key], defaults[key[0]]) for key in sorted(stated))


def _annotations(notes: Mapping[object, _Notes]) -> dict[_Key, list[_Notes]]:
    """Annotations of each (property, subject, target), one list for each owl:Axiom node."""
    found: dict[_Key, list[_Notes]] = defaultdict(list)
    parts = (v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_TARGET)
    for annotation_notes in notes.values():
        by_predicate = dict(annotation_notes)
        key = [by_predicate.get(part) for part in parts]
        if all(isinstance(term, NamedNode) for term in key):
            kind, subject, target = (term.value for term in key if isinstance(term, NamedNode))
            found[kind, subject, target].append(annotation_notes)
    return found


def _relation(key: _Key, axioms: list[_Notes], default: _Notes) -> Relation:
    imported = [notes for notes in axioms if as_imported(notes)]
    by_people = [note for notes in axioms if not as_imported(notes) for note in notes]
    evidence = [_evidence(key, notes, [], stated=False) for notes in imported]
    evidence.sort(key=lambda e: (-e.probability, [str(source) for source in e.sources]))
    if by_people or not imported:
        evidence.insert(0, _evidence(key, by_people, default, stated=True))
    probability = evidence[0].probability
    decisive = [
        e for e in evidence if (e.stated, e.probability) == (evidence[0].stated, probability)
    ]
    sources = sorted({source for e in decisive for source in e.sources}, key=str)
    return Relation(*key, probability, tuple(sources), tuple(evidence))


def _evidence(key: _Key, own: _Notes, default: _Notes, *, stated: bool) -> RelationEvidence:
    return RelationEvidence(
        _probability(key, own, default),
        _sources(own),
        max(_weights(key, own, v.WEIGHT), default=None),
        max(_weights(key, own, v.WEIGHT_AGAINST), default=0.0),
        stated,
    )


def _probability(key: _Key, own: _Notes, default: _Notes) -> float:
    stated = _literals(own, v.PROBABILITY) or _literals(default, v.PROBABILITY)
    numbers = {_number(text) for text in stated}
    if len(numbers) == 1 and 0 <= (number := numbers.pop()) <= 1:
        return number
    given = " and ".join(sorted(stated)) or "none"
    raise OntologyError(f"{_words(key)} needs one here:probability between 0 and 1, has {given}")


def _weights(key: _Key, own: _Notes, predicate: str) -> list[float]:
    weights = {text: _number(text) for text in _literals(own, predicate)}
    for text, weight in weights.items():
        if not (math.isfinite(weight) and weight >= 0):
            raise OntologyError(
                f"{_words(key)} needs a {_short(predicate)} that is a number of at least 0, "
                f"has {text}"
            )
    return list(weights.values())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _words(key: _Key) -> str:
    return " ".join(_short(iri) for iri in (key[1], key[0], key[2]))


def _short(iri: str) -> str:
    return f"here:{iri.removeprefix(v.HERE)}" if iri.startswith(v.HERE) else f"<{iri}>"


def _literals(notes: _Notes, predicate: str) -> set[str]:
    return {o.value for p, o in notes if p == predicate and isinstance(o, Literal)}


def _sources(notes: _Notes) -> tuple[str | Literal, ...]:
    """IRIs as str, words as they are; sorted, each once."""
    terms = {o for p, o in notes if p == v.DCT_SOURCE and isinstance(o, NamedNode | Literal)}
    return tuple(t.value if isinstance(t, NamedNode) else t for t in sorted(terms, key=str))
