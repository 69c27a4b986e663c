"""Common sense as people write it: annotated relations between classes of an ontology.

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

from kg import vocabulary as v
from kg.errors import OntologyError

#: The properties that relate classes.
KINDS: Final = (v.LOCATED_AT, v.NEAR_BY)

_Notes = list[tuple[str, object]]


@dataclass(frozen=True, slots=True)
class Relation:
    """One edge of common sense: things of class `subject` are found at, or near, `target`."""

    kind: str  # IRI: here:locatedAt or here:nearBy
    subject: str  # IRI of a class
    target: str  # IRI of a class
    probability: float  # 0..1
    sources: tuple[str | Literal, ...] = ()  # an IRI, or words as they stand in the ontology

    @property
    def iri(self) -> str:
        """The IRI of its node in graph:commonsense."""
        return f"{v.RELATION}{_name(self.kind)}/{_name(self.subject)}/{_name(self.target)}"


def _name(iri: str) -> str:
    return iri.removeprefix(v.HERE) if iri.startswith(v.HERE) else quote(iri, safe="")


def relations(quads: Iterable[Quad]) -> tuple[Relation, ...]:
    """The relations between classes, each with the probability and the sources annotated on it.

    A relation without a probability of its own takes that of its property
    (``here:locatedAt here:probability 0.2e0``).

    Raises:
        OntologyError: a relation has no probability, two, or one that is not in 0..1.
    """
    stated: set[tuple[str, str, str]] = set()
    notes: dict[object, list[tuple[str, object]]] = defaultdict(list)
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
    return tuple(
        Relation(
            *key, _probability(key, annotated[key], defaults[key[0]]), _sources(annotated[key])
        )
        for key in sorted(stated)
    )


def _annotations(notes: Mapping[object, _Notes]) -> dict[tuple[str, str, str], _Notes]:
    """What owl:Axiom nodes say of each (property, subject, target)."""
    found: dict[tuple[str, str, str], _Notes] = defaultdict(list)
    parts = (v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_TARGET)
    for said in notes.values():
        by_predicate = dict(said)
        key = [by_predicate.get(part) for part in parts]
        if all(isinstance(term, NamedNode) for term in key):
            kind, subject, target = (term.value for term in key if isinstance(term, NamedNode))
            found[kind, subject, target].extend(said)
    return found


def _probability(key: tuple[str, str, str], own: _Notes, default: _Notes) -> float:
    stated = _stated_probabilities(own) or _stated_probabilities(default)
    numbers = {_number(text) for text in stated}
    if len(numbers) == 1 and 0 <= (number := numbers.pop()) <= 1:
        return number
    relation = " ".join(_short(iri) for iri in (key[1], key[0], key[2]))
    given = " and ".join(sorted(stated)) or "none"
    raise OntologyError(f"{relation} needs one here:probability between 0 and 1, has {given}")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _short(iri: str) -> str:
    return f"here:{iri.removeprefix(v.HERE)}" if iri.startswith(v.HERE) else f"<{iri}>"


def _stated_probabilities(notes: _Notes) -> set[str]:
    return {o.value for p, o in notes if p == v.PROBABILITY and isinstance(o, Literal)}


def _sources(notes: _Notes) -> tuple[str | Literal, ...]:
    """IRIs as str, words as they are; sorted, each once."""
    terms = {o for p, o in notes if p == v.DCT_SOURCE and isinstance(o, NamedNode | Literal)}
    return tuple(t.value if isinstance(t, NamedNode) else t for t in sorted(terms, key=str))
