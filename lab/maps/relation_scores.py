"""Scores of spatial relations against a complete truth.

A relation counts where its object is matched to an entry whose relations the truth knows. It is
right if its target is matched to the true target. The truth names the support of each thing. Two
things are truly beside each other if they have the same support and their boxes lie within the
limits of `mapping.relations.probabilities`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from kg.model.records import ObjectRecord, Relation, RelationKind
from lab.maps.complete_truth import TrueObject
from lab.maps.truth_matching import TruthMatcher
from lab.networks.calibration import reliability
from mapping.relations.probabilities import Box, Boxes, RelationSettings, truly_beside

SCORED: Final[tuple[RelationKind, ...]] = ("on", "beside")  # inside: no truth says it
STATED: Final = 0.5  # probability from which on a relation is stated


@dataclass(frozen=True, slots=True)
class RelationScore:
    """Scores of one kind of relation."""

    kind: RelationKind
    true: int  # true ones between objects that the map has
    stated: int
    right: int
    recall: float | None
    precision: float | None
    ece: float | None  # of the probabilities of all that are kept, stated or not


@dataclass(slots=True)
class RelationOutcomes:
    """Relations of one or several maps, and whether they are true."""

    outcomes: dict[RelationKind, list[tuple[float, bool]]] = field(
        default_factory=lambda: {kind: [] for kind in SCORED}
    )
    true: dict[RelationKind, int] = field(default_factory=lambda: dict.fromkeys(SCORED, 0))

    def add(self, other: RelationOutcomes) -> None:
        """Count those of another map too."""
        for kind in SCORED:
            self.outcomes[kind] += other.outcomes[kind]
            self.true[kind] += other.true[kind]

    def scores(self) -> tuple[RelationScore, ...]:
        """Scores of each kind; none where the truth knows no relations."""
        return tuple(self._score(kind) for kind in SCORED if self.true[kind] or self.outcomes[kind])

    def _score(self, kind: RelationKind) -> RelationScore:
        stated = [right for probability, right in self.outcomes[kind] if probability >= STATED]
        return RelationScore(
            kind=kind,
            true=self.true[kind],
            stated=len(stated),
            right=sum(stated),
            recall=sum(stated) / self.true[kind] if self.true[kind] else None,
            precision=sum(stated) / len(stated) if stated else None,
            ece=reliability(self.outcomes[kind]).ece,
        )


def relation_outcomes(
    records: Iterable[ObjectRecord], matched: dict[str, int], matcher: TruthMatcher
) -> RelationOutcomes:
    """Outcomes of a map's relations; `matched` has the entry of each object's IRI."""
    found, truth = RelationOutcomes(), matcher.truth
    if all(entry.on is None for entry in truth):
        return found
    true = {"on": _on(truth), "beside": _beside(truth, matcher)}
    present = set(matched.values())
    for kind in SCORED:
        found.true[kind] = sum(a in present and b in present for a, b in true[kind])
        found.outcomes[kind] = [
            (
                relation.probability,
                (matched[record.iri], matched.get(relation.target)) in true[kind],
            )
            for record in records
            for relation in record.relations or ()
            if relation.kind == kind and _known(record, relation, matched, truth)
        ]
    return found


def _known(
    record: ObjectRecord,
    relation: Relation,
    matched: dict[str, int],
    truth: Sequence[TrueObject],
) -> bool:
    """Whether the truth knows if a relation holds: of ghosts it knows nothing."""
    entry = matched.get(record.iri)
    if entry is None or (relation.kind == "beside" and relation.target not in matched):
        return False
    return truth[entry].on is not None


def _on(truth: Sequence[TrueObject]) -> set[tuple[int, int]]:
    number = {entry.name: i for i, entry in enumerate(truth)}
    return {(i, number[e.on]) for i, e in enumerate(truth) if e.on is not None and e.on in number}


def _beside(truth: Sequence[TrueObject], matcher: TruthMatcher) -> set[tuple[int, int]]:
    known = [i for i, entry in enumerate(truth) if len(entry.extent) == 3]
    boxes = [_box(matcher.p_map[i], truth[i]) for i in known]
    pairs = np.argwhere(truly_beside(Boxes.of(boxes), RelationSettings())).tolist()
    carried = _on(truth)
    return {
        (known[a], known[b])
        for a, b in pairs
        if truth[known[a]].on == truth[known[b]].on
        and not carried & {(known[a], known[b]), (known[b], known[a])}
    }


def _box(p_map: np.ndarray, entry: TrueObject) -> Box:
    half = np.array(entry.extent) / 2
    return Box(p_map - half, p_map + half, 0.0, entry.label)
