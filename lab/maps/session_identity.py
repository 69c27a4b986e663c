"""Identity of objects against a complete truth: within a run, and between sessions.

Switches, as in CLEAR MOT (Bernardin and Stiefelhagen, 2008): after each transaction an object keeps
the true object that it matched before, as long as it still may; the rest is matched nearest first.
A true object whose last match was another object counts one switch.

Sessions: a thing of the truth keeps its name while it moves. Pairs are counted, as for IDF1
(Ristani et al., 2016): of the things that count in both sessions, those whose object has the same
IRI in both; and of the objects that match a thing in both sessions, those for which it is the same
thing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord
from kg.model.transactions import ChangeSet
from kg.model.vocabulary import MAP_GRAPH
from lab.maps.truth_matching import MappedObject, Matching, TruthMatcher

SHOWN: Final = 0.5  # existence from which an object takes part


def identity_switches(states: Iterable[Iterable[MappedObject]], matcher: TruthMatcher) -> int:
    """Number of switches over the states of a map, in order of time."""
    switches = 0
    last: dict[int, str] = {}  # true object -> IRI of its last match
    current: dict[int, str] = {}
    for state in states:
        shown = {o.iri: o for o in state if o.existence >= SHOWN}
        current = _correspondences(shown, current, matcher)
        switches += sum(last.get(i, iri) != iri for i, iri in current.items())
        last |= current
    return switches


def object_states(semantic_map: SemanticMap, since: int = 0) -> Iterator[tuple[ObjectRecord, ...]]:
    """The objects of a map after each transaction behind number `since` that changed one.

    Raises HistoryError where the map does not keep all of its past.
    """
    quads: dict[str, set[Any]] = {}  # of graph:map, by subject
    records: dict[str, ObjectRecord] = {}
    codec = RecordCodec(semantic_map.base, semantic_map.catalogue)
    for change in semantic_map.history.changes():
        changed = _apply(change, quads)
        found = {o.iri: o for iri in changed for o in codec.objects_among(quads[iri])}
        gone = changed & records.keys() - found.keys()
        for iri in gone:
            del records[iri]
        records |= found
        if (found or gone) and change.sequence > since:
            yield tuple(records.values())


def _apply(change: ChangeSet, quads: dict[str, set[Any]]) -> set[str]:
    """Apply a transaction to `quads`; returns the subjects that it changed."""
    changed = set()
    for edit, facts in ((set.discard, change.removed), (set.add, change.added)):
        for quad in facts:
            subject = str(getattr(quad.subject, "value", quad.subject))
            if quad.graph_name == MAP_GRAPH:
                edit(quads.setdefault(subject, set()), quad)
                changed.add(subject)
    return changed


def _correspondences(
    shown: Mapping[str, MappedObject], before: Mapping[int, str], matcher: TruthMatcher
) -> dict[int, str]:
    """True object -> IRI of its match: those of `before` that still hold, then the nearest."""
    kept = {i: iri for i, iri in before.items() if iri in shown and matcher.matches(shown[iri], i)}
    left = [o for iri, o in shown.items() if iri not in kept.values()]
    pairs = matcher.pairs(left, range(len(left)), taken=kept)
    return kept | {pair.true: left[pair.mapped].iri for pair in pairs}


@dataclass(frozen=True, slots=True)
class IdentityScore:
    """Counts of pairs, and what follows from them."""

    things: int = 0  # that count in the truth of both sessions
    objects: int = 0  # that match a thing in both sessions
    right: int = 0  # the same thing

    def __add__(self, other: IdentityScore) -> IdentityScore:
        return IdentityScore(
            self.things + other.things, self.objects + other.objects, self.right + other.right
        )

    @property
    def wrong(self) -> int:
        """Objects that are another thing in the second session."""
        return self.objects - self.right

    @property
    def recall(self) -> float | None:
        """Share of the things that are one object in both sessions."""
        return self.right / self.things if self.things else None

    @property
    def precision(self) -> float | None:
        """Share of the objects that are the same thing in both sessions."""
        return self.right / self.objects if self.objects else None

    @property
    def f1(self) -> float | None:
        """Harmonic mean of both; things missed in a session count against it."""
        total = self.things + self.objects
        return 2 * self.right / total if total else None

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        names = ("wrong", "recall", "precision", "f1")
        return asdict(self) | {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True)
class SessionIdentity:
    """Identity of all things, and of those that moved between the sessions."""

    everything: IdentityScore
    moved: IdentityScore

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return {"all": self.everything.to_json(), "moved": self.moved.to_json()}


Session = tuple[Matching, TruthMatcher]


def session_identity(before: Session, after: Session) -> SessionIdentity:
    """Compare a map at the end of two sessions, each matched to its truth."""
    first, second = _names(before[1]), _names(after[1])
    moved = {t.name for t in after[1].truth if t.moved}
    old, new = _things(before), _things(after)
    pairs = [(old[iri], new[iri]) for iri in old.keys() & new.keys()]
    return SessionIdentity(
        _score(first & second, pairs),
        _score(first & second & moved, [pair for pair in pairs if moved.intersection(pair)]),
    )


def pooled_identity(found: Iterable[SessionIdentity]) -> SessionIdentity:
    """Counts of several maps together."""
    everything, moved = IdentityScore(), IdentityScore()
    for one in found:
        everything, moved = everything + one.everything, moved + one.moved
    return SessionIdentity(everything, moved)


def _score(names: set[str], pairs: list[tuple[str, str]]) -> IdentityScore:
    return IdentityScore(len(names), len(pairs), sum(a == b for a, b in pairs))


def _names(matcher: TruthMatcher) -> set[str]:
    return {t.name for t in matcher.truth if not t.ignore}


def _things(session: Session) -> dict[str, str]:
    """IRI of each matched object -> name of its thing."""
    matching, matcher = session
    return {matching.mapped[p.mapped].iri: matcher.truth[p.true].name for p in matching.matched}
