"""Commonsense relations: annotated relations between classes of an ontology.

`here:Banana here:locatedAt here:Kitchen` is an annotation between two classes. Its probability and
source are annotations of that statement (an owl:Axiom node), which Protege shows and edits.
"""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import OntologyError

#: The properties that relate classes.
KINDS: Final = (v.LOCATED_AT, v.NEAR_BY)

#: Predicates outside of an imported axiom's content.
_FORM: Final = (v.RDF_TYPE.value, v.IMPORT_MARK)
_NUMBERS: Final = tuple(v.XSD + name for name in ("double", "decimal", "integer", "float"))

Notes = list[tuple[str, object]]  # (predicate IRI, term) of one subject
Key = tuple[str, str, str]  # property, subject, target; all IRIs


@dataclass(frozen=True, slots=True)
class RelationEvidence:
    """Evidence of one source: an owl:Axiom node of an importer, or all statements of people."""

    probability: float  # 0..1
    sources: tuple[str | Literal, ...] = ()  # an IRI, or a literal as in the ontology
    weight: float | None = None  # total weight of the evidence by the source's own measure; >= 0
    weight_against: float = 0.0  # total weight of the evidence against it
    stated: bool = True  # by a person; also an imported relation that a person edited

    @property
    def imported(self) -> bool:
        """Whether the evidence is unchanged since its import."""
        return self.weight is not None and not self.stated


@dataclass(frozen=True, slots=True)
class CategoryRelation:
    """A relation of common sense: objects of class `subject` are found at, or near, `target`.

    `probability` is the one stated by people, or else the highest imported one. `sources` are the
    sources of that probability.
    """

    kind: str  # IRI: here:locatedAt or here:nearBy
    subject: str  # IRI of a class
    target: str  # IRI of a class
    probability: float  # 0..1
    sources: tuple[str | Literal, ...] = ()
    evidence: tuple[RelationEvidence, ...] = ()  # one or more; statements of people first

    @property
    def iri(self) -> str:
        """The IRI of the relation's node in graph:commonsense."""
        return f"{v.RELATION}{_name(self.kind)}/{_name(self.subject)}/{_name(self.target)}"


def _name(iri: str) -> str:
    return iri.removeprefix(v.HERE) if iri.startswith(v.HERE) else quote(iri, safe="")


def relations(quads: Iterable[Quad]) -> tuple[CategoryRelation, ...]:
    """The relations between classes, each with its annotated evidence.

    An owl:Axiom node that is unchanged since its import (`as_imported`) is separate evidence. All
    other nodes of a relation together are the statement of people. A relation without annotations
    has the probability of its property (``here:locatedAt here:probability 0.2e0``).

    Raises:
        OntologyError: evidence does not have exactly one probability within 0..1, or has a weight
            that is not a number of at least 0.
    """
    stated: set[Key] = set()
    notes: dict[object, Notes] = defaultdict(list)
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


def _annotations(notes: Mapping[object, Notes]) -> dict[Key, list[Notes]]:
    """Annotations of each (property, subject, target), one list for each owl:Axiom node."""
    found: dict[Key, list[Notes]] = defaultdict(list)
    for axiom in notes.values():
        if (key := annotated_key(axiom)) is not None:
            found[key].append(axiom)
    return found


def annotated_key(axiom: Notes) -> Key | None:
    """The relation that an owl:Axiom node annotates; None for other nodes."""
    by_predicate = dict(axiom)
    parts = (v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_TARGET)
    terms = [term for part in parts if isinstance(term := by_predicate.get(part), NamedNode)]
    if len(terms) != len(parts):
        return None
    kind, subject, target = (term.value for term in terms)
    return kind, subject, target


def _relation(key: Key, axioms: list[Notes], default: Notes) -> CategoryRelation:
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
    return CategoryRelation(*key, probability, tuple(sources), tuple(evidence))


def _evidence(key: Key, own: Notes, default: Notes, *, stated: bool) -> RelationEvidence:
    return RelationEvidence(
        _probability(key, own, default),
        _sources(own),
        max(_weights(key, own, v.WEIGHT), default=None),
        max(_weights(key, own, v.WEIGHT_AGAINST), default=0.0),
        stated,
    )


def _probability(key: Key, own: Notes, default: Notes) -> float:
    stated = _literals(own, v.PROBABILITY) or _literals(default, v.PROBABILITY)
    numbers = {_number(text) for text in stated}
    if len(numbers) == 1 and 0 <= (number := numbers.pop()) <= 1:
        return number
    given = " and ".join(sorted(stated)) or "none"
    raise OntologyError(f"{_words(key)} needs one here:probability between 0 and 1, has {given}")


def _weights(key: Key, own: Notes, predicate: str) -> list[float]:
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


def mark_of(notes: Iterable[tuple[str, object]]) -> str:
    """Short digest of an axiom's content: (predicate IRI, term) in any order.

    Numbers count by value: an ontology editor may write 0.2e0 as 0.2.
    """
    lines = sorted({f"{p} {_canonical(o)}" for p, o in notes if p not in _FORM})
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def as_imported(notes: Iterable[tuple[str, object]]) -> bool:
    """Whether an axiom has an importer's digest that still matches its content."""
    notes = tuple(notes)
    marks = {o.value for p, o in notes if p == v.IMPORT_MARK and isinstance(o, Literal)}
    return marks == {mark_of(notes)}


def _canonical(term: object) -> str:
    if isinstance(term, Literal):
        if term.datatype.value in _NUMBERS:
            with suppress(ValueError):
                return repr(float(term.value))
            return term.value
        return f'"{term.value}"@{term.language or ""}'
    return f"<{term.value}>" if isinstance(term, NamedNode) else "[]"


def _words(key: Key) -> str:
    return " ".join(_short(iri) for iri in (key[1], key[0], key[2]))


def _short(iri: str) -> str:
    return f"here:{iri.removeprefix(v.HERE)}" if iri.startswith(v.HERE) else f"<{iri}>"


def _literals(notes: Notes, predicate: str) -> set[str]:
    return {o.value for p, o in notes if p == predicate and isinstance(o, Literal)}


def _sources(notes: Notes) -> tuple[str | Literal, ...]:
    """Sources: IRIs as str, literals unchanged; sorted, without duplicates."""
    terms = {o for p, o in notes if p == v.DCT_SOURCE and isinstance(o, NamedNode | Literal)}
    return tuple(t.value if isinstance(t, NamedNode) else t for t in sorted(terms, key=str))
