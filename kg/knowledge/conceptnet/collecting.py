"""Collection of edges as evidence for relations between categories."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from kg.knowledge.conceptnet.edges import Edge, Node
from kg.knowledge.conceptnet.names import TermMatcher, reduced

#: Weight of an assertion of each relation as evidence that an object is found in a place.
PLACE_SHARES: Final = {"AtLocation": 1.0, "HasA": 0.5, "PartOf": 0.5, "LocatedNear": 0.5}
#: Weight of an assertion of each relation as evidence that an object is found near another.
NEAR_SHARES: Final = {"LocatedNear": 1.0, "AtLocation": 0.5}

#: Weight of an ambiguous name ("notebook", or "table" for a dining table) relative to a category's
#: own name.
DOUBTFUL_SHARE: Final = 0.5

#: A normalised term, and WordNet's topic of its sense where the source states it.
Key = tuple[str, str]


@dataclass(slots=True)
class EdgeEvidence:
    """Evidence of one assertion for a fact."""

    votes: float
    surface: str
    license: str


@dataclass(slots=True)
class TermRelation:
    """Evidence for and against one relation of a term."""

    #: (source, whether negated) -> evidence
    evidence: dict[tuple[str, bool], EdgeEvidence] = field(default_factory=dict)

    def add(self, assertion: Edge, share: float = 1.0) -> None:
        """Add an assertion; a repeated one counts once unless its votes add up (`Edge.adds`)."""
        key, votes = (assertion.source, assertion.negated), assertion.votes * share
        if (entry := self.evidence.get(key)) is None:
            self.evidence[key] = EdgeEvidence(votes, assertion.surface, assertion.license)
        else:
            entry.votes = entry.votes + votes if assertion.adds else max(entry.votes, votes)

    def votes(self, *, negated: bool = False) -> float:
        """Sum of the votes for the relation, or against it if `negated`."""
        return sum(entry.votes for (_, no), entry in self.evidence.items() if no is negated)

    @property
    def net(self) -> float:
        """Votes for the relation minus votes against it."""
        return self.votes() - self.votes(negated=True)


Facts = dict[Key, dict[str, TermRelation]]


class EdgeCollection:
    """Evidence collected from edges, by their start term.

    All terms have places, which sense disambiguation and inheritance from parents need. Terms of
    objects also have relations to other objects, containers, wholes, parents and synonyms.
    """

    def __init__(self, names: TermMatcher) -> None:
        self.names = names
        self.at_place: Facts = defaultdict(dict)  # any term -> IRI of a place category
        self.near: Facts = defaultdict(dict)  # an object's term -> IRI of an object category
        self.is_a: dict[Key, dict[Key, TermRelation]] = defaultdict(dict)  # any term -> its parents
        self.same_as: dict[Key, dict[Key, TermRelation]] = defaultdict(dict)
        self.inside: dict[Key, dict[Key, TermRelation]] = defaultdict(dict)  # object's -> container
        self.part_of: dict[Key, dict[Key, TermRelation]] = defaultdict(dict)  # object's -> whole
        self.naming: dict[Key, str] = {}  # terms that name an object category -> its IRI

    def accepts(self, relation: str, start: str, end: str) -> bool:
        """Whether an assertion between these terms may be relevant; may overestimate."""
        thing, place = self._object, self._place
        if relation in ("AtLocation", "PartOf"):
            return place(end) or thing(start)
        if relation == "HasA":
            return place(start) or thing(end)
        if relation == "IsA":
            return thing(start) or self.names.get(end, "supercategory") is not None
        return thing(start) or thing(end)

    def add_all(self, assertions: Iterable[Edge]) -> int:
        """Add all relevant assertions; returns their number."""
        kept = 0
        for assertion in assertions:
            start, end = self._key(assertion.start), self._key(assertion.end)
            if start is not None and end is not None and start[0] and end[0]:
                self._add(assertion, start, end)
                kept += 1
        return kept

    def _add(self, assertion: Edge, start: Key, end: Key) -> None:
        match assertion.relation:
            case "AtLocation":
                self._is_at(assertion, start, assertion.end)
                self._is_near(assertion, start, assertion.end)
                self._is_in(self.inside, assertion, start, end)
            case "PartOf":
                self._is_at(assertion, start, assertion.end)
                self._is_in(self.part_of, assertion, start, end)
            case "HasA":
                self._is_at(assertion, end, assertion.start)
                self._is_in(self.part_of, assertion, end, start)
            case "LocatedNear":
                self._is_near(assertion, start, assertion.end)
                self._is_near(assertion, end, assertion.start)
                self._is_at(assertion, start, assertion.end)
                self._is_at(assertion, end, assertion.start)
            case "IsA":
                self.is_a[start].setdefault(end, TermRelation()).add(assertion)
            case "Synonym":
                self.same_as[start].setdefault(end, TermRelation()).add(assertion)
                self.same_as[end].setdefault(start, TermRelation()).add(assertion)

    def _is_at(self, assertion: Edge, start: Key, end: Node) -> None:
        if place := self.names.get(end.term, "place"):
            fact = self.at_place[start].setdefault(place, TermRelation())
            fact.add(assertion, PLACE_SHARES[assertion.relation])

    def _is_near(self, assertion: Edge, start: Key, end: Node) -> None:
        other = self.names.get(end.term, "object")
        if other and start in self.naming and self.naming[start] != other:
            fact = self.near[start].setdefault(other, TermRelation())
            wider = self.names.generic(end.term, other)
            share = DOUBTFUL_SHARE if wider else 1.0
            fact.add(assertion, NEAR_SHARES[assertion.relation] * share)

    def _is_in(
        self, links: dict[Key, dict[Key, TermRelation]], assertion: Edge, start: Key, end: Key
    ) -> None:
        if start in self.naming and start != end and not self._place(assertion.end.term):
            link = links[start].setdefault(end, TermRelation())
            link.add(assertion, PLACE_SHARES[assertion.relation])

    def _key(self, node: Node) -> Key | None:
        """Key of a noun, registered if its term names an object; None for other parts of speech."""
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
