"""Identity between sessions: whether the things of one session are the same objects in the next.

A thing of the truth keeps its name while it moves. Pairs are counted, as for IDF1 (Ristani et al.,
2016): of the things that count in both sessions, those whose object has the same IRI in both; and
of the objects that match a thing in both sessions, those for which it is the same thing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from mapping.evaluation.truth_matching import Matching, TruthMatcher


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
