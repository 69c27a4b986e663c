"""Assertions sorted into facts about our categories, as far as they can be such."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from kg.conceptnet.assertion import Assertion, Node
from kg.conceptnet.names import Names, reduced

#: What an assertion of that relation counts as evidence that a thing is found in a place.
PLACE_SHARES: Final = {"AtLocation": 1.0, "HasA": 0.5, "PartOf": 0.5, "LocatedNear": 0.5}
#: The same, as evidence that a thing is found near another.
NEAR_SHARES: Final = {"LocatedNear": 1.0, "AtLocation": 0.5}

#: A term, reduced, and WordNet's topic of the sense that is meant, where the source says it.
Key = tuple[str, str]


@dataclass(slots=True)
class Voice:
    """One assertion behind a fact."""

    votes: float
    surface: str
    license: str


@dataclass(slots=True)
class Fact:
    """All that was said for and against one thing."""

    voices: dict[tuple[str, bool], Voice] = field(default_factory=dict)  # (source, negated) ->

    def hear(self, assertion: Assertion, share: float = 1.0) -> None:
        """Add an assertion; one already heard counts once, unless its votes are other votes."""
        key, votes = (assertion.source, assertion.negated), assertion.votes * share
        if (known := self.voices.get(key)) is None:
            self.voices[key] = Voice(votes, assertion.surface, assertion.license)
        else:
            known.votes = known.votes + votes if assertion.adds else max(known.votes, votes)

    def votes(self, *, negated: bool = False) -> float:
        """The votes for it; or against it."""
        return sum(voice.votes for (_, no), voice in self.voices.items() if no is negated)

    @property
    def net(self) -> float:
        """Votes for less votes against."""
        return self.votes() - self.votes(negated=True)


Facts = dict[Key, dict[str, Fact]]


class Collection:
    """What is known so far: facts by the term they start from.

    Kept are places of any term (who else is found there tells senses apart, and parents pass on
    where they are found), and of our objects what they are near, are, and mean.
    """

    def __init__(self, names: Names) -> None:
        self.names = names
        self.at_place: Facts = defaultdict(dict)  # any term -> IRI of a place category
        self.near: Facts = defaultdict(dict)  # an object's term -> IRI of an object category
        self.is_a: dict[Key, dict[Key, Fact]] = defaultdict(dict)  # any term -> what it is
        self.same_as: dict[Key, dict[Key, Fact]] = defaultdict(dict)
        self.naming: dict[Key, str] = {}  # terms that name an object category -> its IRI

    def wants(self, relation: str, start: str, end: str) -> bool:
        """Whether an assertion between these terms could be of use; cheap, says yes in doubt."""
        thing, place = self._object, self._place
        if relation == "AtLocation":
            return place(end) or (thing(start) and thing(end))
        if relation == "PartOf":
            return place(end)
        if relation == "HasA":
            return place(start)
        if relation == "IsA":
            return thing(start) or self._group(end)
        return thing(start) or thing(end)

    def take(self, assertions: Iterable[Assertion]) -> int:
        """Keep what is of use; returns how many assertions were."""
        kept = 0
        for assertion in assertions:
            start, end = self._key(assertion.start), self._key(assertion.end)
            if start is not None and end is not None and start[0] and end[0]:
                getattr(self, f"_take_{assertion.relation.lower()}")(assertion, start, end)
                kept += 1
        return kept

    def _take_atlocation(self, assertion: Assertion, start: Key, end: Key) -> None:
        self._is_at(assertion, start, assertion.end)
        self._is_near(assertion, start, assertion.end)

    def _take_partof(self, assertion: Assertion, start: Key, end: Key) -> None:
        self._is_at(assertion, start, assertion.end)

    def _take_hasa(self, assertion: Assertion, start: Key, end: Key) -> None:
        self._is_at(assertion, end, assertion.start)

    def _take_locatednear(self, assertion: Assertion, start: Key, end: Key) -> None:
        self._is_near(assertion, start, assertion.end)
        self._is_near(assertion, end, assertion.start)
        self._is_at(assertion, start, assertion.end)
        self._is_at(assertion, end, assertion.start)

    def _take_isa(self, assertion: Assertion, start: Key, end: Key) -> None:
        self.is_a[start].setdefault(end, Fact()).hear(assertion)

    def _take_synonym(self, assertion: Assertion, start: Key, end: Key) -> None:
        self.same_as[start].setdefault(end, Fact()).hear(assertion)
        self.same_as[end].setdefault(start, Fact()).hear(assertion)

    def _is_at(self, assertion: Assertion, start: Key, end: Node) -> None:
        if place := self.names.get(end.term, "place"):
            fact = self.at_place[start].setdefault(place, Fact())
            fact.hear(assertion, PLACE_SHARES[assertion.relation])

    def _is_near(self, assertion: Assertion, start: Key, end: Node) -> None:
        other = self.names.get(end.term, "object")
        if other and start in self.naming and self.naming[start] != other:
            fact = self.near[start].setdefault(other, Fact())
            fact.hear(assertion, NEAR_SHARES[assertion.relation])

    def _key(self, node: Node) -> Key | None:
        """The node's key, its term noted where it names an object; None for verbs and the like."""
        if node.speech not in ("", "n"):
            return None
        key = (reduced(node.term), node.sense)
        if key not in self.naming and (iri := self.names.get(node.term, "object")):
            self.naming[key] = iri
        return key

    def _object(self, term: str) -> bool:
        return (self.names.get(term, "object") or self.names.doubtful(term)) is not None

    def _place(self, term: str) -> bool:
        return self.names.get(term, "place") is not None

    def _group(self, term: str) -> bool:
        return self.names.get(term, "supercategory") is not None
