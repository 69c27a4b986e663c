"""Aggregation of evidence about terms into relations between categories."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from kg.knowledge.conceptnet.collecting import DOUBTFUL_SHARE, EdgeCollection, Key, TermRelation
from kg.knowledge.conceptnet.edges import LOCATED, NEAR, probability_of, weight_of
from kg.knowledge.conceptnet.names import TermMatcher, reduced
from kg.knowledge.conceptnet.senses import PLAIN, SenseFilter
from kg.model import vocabulary as v

#: Votes from which two things without a common place are near each other.
MIN_VOTES_APART: Final = 2.0
#: Votes up to which a thing of the open is not in a room, nor a thing of rooms in the open; and the
#: share of its votes from which it is one.
MAX_VOTES_ACROSS: Final = 1.0
MIN_SHARE_ACROSS: Final = 0.9
#: Labels of the wider kinds of places in which the meat of animals is sold and eaten.
_OF_FOOD: Final = frozenset({"shop", "eating place"})


class Plausibility:
    """Whether a relation agrees with the other relations of an import.

    People also say what is alike ("zebra near horse"), what is made of a thing ("cow at the
    butcher's shop") and what they once saw ("car in a museum"). Such statements have a few votes
    each, so a threshold of votes that excludes them would exclude most true ones too:

    - things are near each other if they have a place in common. Without one, or where the import
      has no place of one of them, two votes are needed, and members of one group are alike;
    - an animal in a shop or where meals are served is its meat;
    - a single vote brings no thing of the open into a room, nor a thing of rooms into the open.

    Args:
        names: has the wider kinds of places.
        senses: has the groups of object categories.
        net: (kind, subject, target) of each relation -> votes for it less votes against it.
    """

    def __init__(
        self, names: TermMatcher, senses: SenseFilter, net: Mapping[tuple[str, str, str], float]
    ) -> None:
        self._names, self._senses = names, senses
        self._located: dict[str, dict[str, float]] = defaultdict(dict)  # object -> place -> votes
        self._net = net
        for (kind, subject, target), votes in net.items():
            if kind == v.LOCATED_AT:
                self._located[subject][target] = votes

    def __call__(self, kind: str, subject: str, target: str) -> bool:
        """Whether the relation is plausible."""
        votes = self._net[kind, subject, target]
        if kind == v.NEAR_BY:
            return self._near(subject, target, votes)
        if kind == v.LOCATED_AT:
            return self._located_at(subject, target, votes)
        return True

    def _near(self, subject: str, target: str, votes: float) -> bool:
        if self._located[subject].keys() & self._located[target].keys():
            return True
        group = self._senses.group(subject)
        alike = group != PLAIN and group == self._senses.group(target)
        return votes >= MIN_VOTES_APART and not alike

    def _located_at(self, subject: str, place: str, votes: float) -> bool:
        if self._senses.is_animal(subject) and _OF_FOOD & self._names.uses(place):
            return False
        indoors, outdoors = self._names.is_indoors, self._names.is_outdoors
        other = outdoors if indoors(place) else indoors
        if votes > MAX_VOTES_ACROSS or not (indoors(place) or outdoors(place)):
            return True
        known = self._located[subject]
        across = sum(n for one, n in known.items() if other(one))
        return across < MIN_SHARE_ACROSS * sum(known.values())


#: Weight of evidence about a kind (fruit) relative to evidence about the object (banana).
INHERITED_SHARE: Final = 0.25
#: Weight of evidence by containers and wholes, for a category without places of its own.
INDIRECT_SHARE: Final = 0.5
#: Minimum votes of a relation; the second for evidence by containers and wholes.
MIN_VOTES: Final = 1.0
MIN_INDIRECT_VOTES: Final = 0.5
#: Minimum votes of a link to a parent, container or whole, and of a subclass.
MIN_VOTES_OF_KIND: Final = 2.0
MIN_VOTES_OF_SUBCLASS: Final = 2.0
#: Maximum votes against a subclass, as a share of the votes for it.
MAX_DISPUTE: Final = 0.25
#: Maximum number of sources; the strongest assertions come first.
MAX_SOURCES: Final = 5


@dataclass(frozen=True, slots=True)
class ImportedRelation:
    """Relation between two categories, with the evidence for and against it."""

    kind: str  # IRI: here:locatedAt, here:nearBy or rdfs:subClassOf
    subject: str  # IRI of a category
    target: str  # IRI of a category
    probability: float | None  # 0..1, three decimals; None for a subclass
    weight: float  # three decimals
    weight_against: float
    sources: tuple[str, ...]  # IRIs, the strongest first
    licenses: tuple[str, ...]  # IRIs
    surfaces: tuple[str, ...]  # of the sources, each once

    @property
    def key(self) -> tuple[str, str, str]:
        """Kind, subject and target."""
        return self.kind, self.subject, self.target


@dataclass(slots=True)
class _Tally:
    """Votes for and against a relation, with their sources."""

    votes: float = 0.0
    against: float = 0.0
    evidence: dict[str, tuple[float, str, str]] = field(default_factory=dict)
    min_votes: float = MIN_VOTES

    @property
    def net(self) -> float:
        """Votes for less votes against, to the precision of weights of ConceptNet 5."""
        return round(self.votes - self.against, 3)

    def add(self, fact: TermRelation, share: float) -> None:
        self.votes += fact.votes() * share
        self.against += fact.votes(negated=True) * share
        for (source, _), entry in fact.evidence.items():
            weighed = (entry.votes * share, entry.surface, entry.license)
            self.evidence[source] = max(self.evidence.get(source, (0.0, "", "")), weighed)

    def merge(self, other: _Tally) -> None:
        self.votes += other.votes
        self.against += other.against
        self.evidence |= other.evidence


_Tallies = dict[str, _Tally]


def relate(
    collection: EdgeCollection, groups: Mapping[str, tuple[str, ...]]
) -> tuple[tuple[ImportedRelation, ...], int]:
    """Relations that a collection supports, sorted; and the number of too weak ones.

    Args:
        collection: all facts.
        groups: IRI of every object category -> IRIs of its supercategories.
    """
    senses = SenseFilter(collection, groups)
    keys: dict[str, list[Key]] = defaultdict(list)
    for key, iri in sorted(collection.naming.items()):
        if not key[1] or senses.fits(iri, key[1]):
            keys[iri].append(key)
    tallied = []
    for category in collection.names.groups["object"]:
        iri = category.iri
        subject = _Subject(collection, senses, iri, keys[iri], groups.get(iri, ()))
        for kind, tallies in (
            (v.LOCATED_AT, subject.located()),
            (v.NEAR_BY, subject.near()),
            (v.RDFS_SUB_CLASS_OF, subject.kinds()),
        ):
            tallied += [(kind, iri, target, t) for target, t in tallies.items() if target != iri]
    enough = {each[:3]: each[3] for each in tallied if _enough(each[0], each[3])}
    net = {key: tally.net for key, tally in enough.items()}
    plausible = Plausibility(collection.names, senses, net)
    found = [_found(*key, tally) for key, tally in enough.items() if plausible(*key)]
    found.sort(key=lambda relation: relation.key)
    return tuple(found), len(tallied) - len(found)


@dataclass(frozen=True, slots=True)
class _Subject:
    """An object category with the terms that name it; tallies the evidence for its relations."""

    collection: EdgeCollection
    senses: SenseFilter
    iri: str
    keys: list[Key]
    supercategories: tuple[str, ...]  # IRIs

    def located(self) -> _Tallies:
        tallies = self._direct()
        strongest: dict[str, TermRelation] = {}
        for parent in self._parents():
            for place, fact in self._places(parent):
                if place not in strongest or fact.net > strongest[place].net:
                    strongest[place] = fact
        for place, fact in strongest.items():
            tallies[place].add(fact, INHERITED_SHARE)
        self._move_indoors(tallies)
        if any(_enough(v.LOCATED_AT, tally) for tally in tallies.values()):
            return tallies
        tallies = self._indirect()
        self._move_indoors(tallies)
        return tallies

    def near(self) -> _Tallies:
        tallies: _Tallies = defaultdict(_Tally)
        for key in self.keys:
            for other, fact in sorted(self.collection.near.get(key, {}).items()):
                wider = self.collection.names.generic(key[0], self.iri)
                share = DOUBTFUL_SHARE if wider else 1.0
                tallies[other].add(fact, share * self.senses.near(key, self.iri, other))
        return tallies

    def kinds(self) -> _Tallies:
        """Supercategories of the category by IsA edges, without rival senses."""
        tallies: _Tallies = defaultdict(_Tally)
        own = self.senses.group(self.iri)
        for key in self.keys:
            for parent, fact in sorted(self.collection.is_a.get(key, {}).items()):
                target = self.collection.names.get(parent[0], "supercategory")
                if target is not None and own in (target, PLAIN):
                    tallies[target].add(fact, 1.0)
        return tallies

    def _places(self, key: Key) -> list[tuple[str, TermRelation]]:
        return sorted(self.collection.at_place.get(key, {}).items())

    def _direct(self) -> _Tallies:
        tallies: _Tallies = defaultdict(_Tally)
        names, doubtful = self.collection.names, self._doubtful()
        wider = [key for key in self.keys if names.generic(key[0], self.iri)]
        for key in self.keys:
            for place, fact in self._places(key):
                # a place that is named alike, such as a dining room, says what table is meant
                if key not in wider or names.shares_modifier(self.iri, place):
                    tallies[place].add(fact, self.senses.at_place(key, self.iri, place))
        known = [place for place, tally in tallies.items() if tally.net >= MIN_VOTES]
        sure = {use for place in known for use in names.uses(place)}
        for key in (*wider, *doubtful):
            for place, fact in self._places(key):
                if key in wider and names.shares_modifier(self.iri, place):
                    continue
                if not sure or sure & names.uses(place):
                    share = DOUBTFUL_SHARE * self.senses.at_place(key, self.iri, place)
                    tallies[place].add(fact, share)
        return tallies

    def _move_indoors(self, tallies: _Tallies) -> None:
        """Count an outdoor place ("hotel outdoor") as indoor if the object is also in rooms."""
        names = self.collection.names
        rooms = [tally for place, tally in tallies.items() if names.is_indoors(place)]
        if not any(_enough(v.LOCATED_AT, tally) for tally in rooms):
            return
        for outdoor, indoor in names.indoors.items():
            tally = tallies.pop(outdoor, None)
            if tally is not None and indoor is not None:
                tallies[indoor].merge(tally)

    def _indirect(self) -> _Tallies:
        """Places of a category without places of its own: places of its containers and wholes.

        A vase is on a table, and tables are in kitchens and dining rooms: each place takes its
        share of the votes for the link.
        """
        tallies = self._direct()
        for other, votes in self._links():
            places = self._places(other)
            facts = {place: fact for place, fact in places if fact.net >= MIN_VOTES_OF_KIND}
            total = sum(fact.net for fact in facts.values())
            for place, fact in facts.items():
                tallies[place].add(fact, INDIRECT_SHARE * votes / total)
        for tally in tallies.values():
            tally.min_votes = MIN_INDIRECT_VOTES
        return tallies

    def _links(self) -> list[tuple[Key, float]]:
        """Containers, wholes and kinds of the category, with their votes; sorted."""
        collection, senses = self.collection, self.senses
        own = senses.group(self.iri)
        votes: dict[Key, float] = defaultdict(float)
        for key in self.keys:
            links = [*collection.part_of.get(key, {}).items()]
            if not senses.rivals(key, self.iri):
                links += collection.inside.get(key, {}).items()
            for parent, fact in collection.is_a.get(key, {}).items():
                category = collection.naming.get(parent)
                if category and category != self.iri and own == senses.group(category) != PLAIN:
                    links.append((parent, fact))
            for other, fact in links:
                votes[other] += fact.net
        return sorted((other, n) for other, n in votes.items() if n >= MIN_VOTES_OF_KIND)

    def _doubtful(self) -> list[Key]:
        """Ambiguous terms: listed ones, and synonyms that name no other category."""
        names = self.collection.names
        found = {key for key in self.collection.at_place if names.doubtful(key[0]) == self.iri}
        for key in self.keys:
            for other, fact in self.collection.same_as.get(key, {}).items():
                if fact.net > 0 and other not in self.collection.naming:
                    found.add(other)
        return sorted(found)

    def _parents(self) -> list[Key]:
        """Parents by IsA edges, without rival senses, and by the ontology."""
        collection, senses = self.collection, self.senses
        found: set[Key] = set()
        for key in self.keys:
            rivals, own = senses.rivals(key, self.iri), senses.group(self.iri)
            for parent, fact in collection.is_a.get(key, {}).items():
                group = senses.group_of(parent)
                same_sense = group == own if own else group not in rivals
                if not same_sense or parent in collection.naming:
                    continue
                if fact.net >= MIN_VOTES_OF_KIND and not senses.divided(parent, self.iri):
                    found.add(parent)
        for category in collection.names.groups["supercategory"]:
            if category.iri in self.supercategories:
                found.update((reduced(name), "") for name in (category.label, *category.synonyms))
        return sorted(found)


def _enough(kind: str, tally: _Tally) -> bool:
    if kind == v.RDFS_SUB_CLASS_OF:  # a subclass has no probability, so its evidence must agree
        disputed = tally.against > MAX_DISPUTE * tally.votes
        return tally.votes >= MIN_VOTES_OF_SUBCLASS and not disputed
    return tally.net >= tally.min_votes


def _found(kind: str, subject: str, target: str, tally: _Tally) -> ImportedRelation:
    weight, against = (round(weight_of(votes), 3) for votes in (tally.votes, tally.against))
    probability = None
    if kind != v.RDFS_SUB_CLASS_OF:
        log_odds = NEAR if kind == v.NEAR_BY else LOCATED
        probability = round(probability_of(weight - against, log_odds), 3)
    ranked = sorted(tally.evidence.items(), key=lambda item: (-item[1][0], item[0]))[:MAX_SOURCES]
    return ImportedRelation(
        kind,
        subject,
        target,
        probability,
        weight,
        against,
        tuple(source for source, _ in ranked),
        tuple(sorted({entry[2] for _, entry in ranked})),
        tuple(dict.fromkeys(entry[1] for _, entry in ranked)),
    )
