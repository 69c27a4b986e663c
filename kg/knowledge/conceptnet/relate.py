"""Aggregation of evidence about terms into relations between categories."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from kg.knowledge.conceptnet.collecting import EdgeCollection, Key, TermRelation
from kg.knowledge.conceptnet.names import reduced
from kg.knowledge.conceptnet.senses import PLAIN, SenseFilter
from kg.knowledge.conceptnet.strength import LOCATED, NEAR, probability_of, weight_of
from kg.model import vocabulary as v

#: Weight of an ambiguous name (a synonym, "notebook") relative to a category's own name.
DOUBTFUL_SHARE: Final = 0.5
#: Weight of evidence about a kind (fruit) relative to evidence about the object (banana).
INHERITED_SHARE: Final = 0.25
#: Weight of evidence about what a category without a place is in, shared by its places.
INDIRECT_SHARE: Final = 0.5
#: Minimum votes of a relation, and of one of a category without a place.
MIN_VOTES: Final = 1.0
MIN_INDIRECT_VOTES: Final = 0.5
#: Minimum votes of a kind that others inherit from, or of another link, and of a subclass.
MIN_VOTES_OF_KIND: Final = 2.0
MIN_VOTES_OF_SUBCLASS: Final = 2.0
#: Maximum votes against a subclass, as a share of those for it.
MAX_DISPUTE: Final = 0.25
#: Number of sources given, the strongest assertions first.
MAX_SOURCES: Final = 5


@dataclass(frozen=True, slots=True)
class ImportedRelation:
    """Relation between two categories, with the evidence for and against it."""

    kind: str  # IRI: here:locatedAt, here:nearBy or rdfs:subClassOf
    subject: str  # IRI of a category
    target: str  # IRI of a category
    probability: float | None  # 0..1, three decimals; None of a subclass: it is one or it is not
    weight: float  # three decimals
    weight_against: float
    sources: tuple[str, ...]  # IRIs, the strongest first
    licenses: tuple[str, ...]  # IRIs
    surfaces: tuple[str, ...]  # of the sources, each once


@dataclass(slots=True)
class _Tally:
    """Votes for and against a relation, with their sources."""

    votes: float = 0.0
    against: float = 0.0
    evidence: dict[str, tuple[float, str, str]] = field(default_factory=dict)
    least: float = MIN_VOTES

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
    """Relations that a collection supports, sorted; and the number of those rejected as too weak.

    Args:
        collection: all facts.
        groups: IRI of every object category -> IRIs of its supercategories.
    """
    senses = SenseFilter(collection, groups)
    tallied = [
        (kind, subject, target, tally)
        for kind, subject, tallies in _tallied(collection, senses, groups)
        for target, tally in tallies.items()
        if target != subject
    ]
    found = [_found(*each) for each in tallied if _enough(each[0], each[3])]
    return tuple(sorted(found, key=_order)), len(tallied) - len(found)


def _order(found: ImportedRelation) -> tuple[str, str, str]:
    return found.kind, found.subject, found.target


def _tallied(
    collection: EdgeCollection, senses: SenseFilter, groups: Mapping[str, tuple[str, ...]]
) -> Iterator[tuple[str, str, _Tallies]]:
    named: dict[str, list[Key]] = defaultdict(list)
    for key, iri in sorted(collection.naming.items()):
        if not key[1] or senses.fits(iri, key[1]):
            named[iri].append(key)
    for category in collection.names.groups["object"]:
        keys, iri = named[category.iri], category.iri
        yield v.LOCATED_AT, iri, _located(collection, senses, iri, keys, groups.get(iri, ()))
        yield v.NEAR_BY, iri, _near(collection, senses, iri, keys)
        yield v.RDFS_SUB_CLASS_OF, iri, _kinds(collection, senses, iri, keys)


def _located(
    collection: EdgeCollection,
    senses: SenseFilter,
    iri: str,
    keys: list[Key],
    supercategories: Iterable[str],
) -> _Tallies:
    tallies = _direct(collection, senses, iri, keys)
    parents = _parents(collection, senses, iri, keys, supercategories)
    strongest: dict[str, TermRelation] = {}
    for parent in parents:
        for place, fact in sorted(collection.at_place.get(parent, {}).items()):
            if place not in strongest or fact.net > strongest[place].net:
                strongest[place] = fact
    for place, fact in strongest.items():
        tallies[place].add(fact, INHERITED_SHARE)
    _move_indoors(collection, tallies)
    if not any(_enough(v.LOCATED_AT, tally) for tally in tallies.values()):
        return _indirect(collection, senses, iri, keys)
    return tallies


def _direct(collection: EdgeCollection, senses: SenseFilter, iri: str, keys: list[Key]) -> _Tallies:
    tallies: _Tallies = defaultdict(_Tally)
    weighed = [(key, 1.0) for key in keys]
    weighed += [(key, DOUBTFUL_SHARE) for key in _doubtful(collection, iri, keys)]
    for key, share in weighed:
        for place, fact in sorted(collection.at_place.get(key, {}).items()):
            tallies[place].add(fact, share * senses.at_place(key, iri, place))
    return tallies


def _move_indoors(collection: EdgeCollection, tallies: _Tallies) -> None:
    """Count outdoor places, as "hotel outdoor", as indoor ones for things also found in rooms."""
    rooms = [tally for place, tally in tallies.items() if place in collection.names.rooms]
    if not any(_enough(v.LOCATED_AT, tally) for tally in rooms):
        return
    for outdoor, indoor in collection.names.indoors.items():
        tally = tallies.pop(outdoor, None)
        if tally is not None and indoor is not None:
            tallies[indoor].merge(tally)


def _indirect(
    collection: EdgeCollection, senses: SenseFilter, iri: str, keys: list[Key]
) -> _Tallies:
    """Places of a category that has none: those of what it is in, part of, or a kind of.

    A vase is on a table, and tables are in kitchens and dining rooms: each place takes its share
    of the votes for the link.
    """
    tallies = _direct(collection, senses, iri, keys)
    for other, votes in _links(collection, senses, iri, keys):
        facts = {
            place: fact
            for place, fact in sorted(collection.at_place.get(other, {}).items())
            if fact.net >= MIN_VOTES_OF_KIND
        }
        total = sum(fact.net for fact in facts.values())
        for place, fact in facts.items():
            tallies[place].add(fact, INDIRECT_SHARE * votes / total)
    for tally in tallies.values():
        tally.least = MIN_INDIRECT_VOTES
    return tallies


def _links(
    collection: EdgeCollection, senses: SenseFilter, iri: str, keys: list[Key]
) -> list[tuple[Key, float]]:
    """Concepts that a category is in, part of, or a kind of, with the votes; sorted."""
    own = senses.group(iri)
    votes: dict[Key, float] = defaultdict(float)
    for key in keys:
        links = [*collection.part_of.get(key, {}).items()]
        if not senses.rivals(key, iri):
            links += collection.inside.get(key, {}).items()
        for parent, fact in collection.is_a.get(key, {}).items():
            category = collection.naming.get(parent)
            if category and category != iri and own == senses.group(category) != PLAIN:
                links.append((parent, fact))
        for other, fact in links:
            votes[other] += fact.net
    return sorted((other, n) for other, n in votes.items() if n >= MIN_VOTES_OF_KIND)


def _doubtful(collection: EdgeCollection, iri: str, keys: list[Key]) -> list[Key]:
    """Ambiguous terms of the category: listed ones, and synonyms that name no other category."""
    found = {key for key in collection.at_place if collection.names.doubtful(key[0]) == iri}
    for key in keys:
        for other, fact in collection.same_as.get(key, {}).items():
            if fact.net > 0 and other not in collection.naming:
                found.add(other)
    return sorted(found)


def _parents(
    collection: EdgeCollection,
    senses: SenseFilter,
    iri: str,
    keys: list[Key],
    supercategories: Iterable[str],
) -> list[Key]:
    """Parents of the category, by its terms and the ontology; without those of rival senses."""
    found: set[Key] = set()
    for key in keys:
        rivals, own = senses.rivals(key, iri), senses.group(iri)
        for parent, fact in collection.is_a.get(key, {}).items():
            meant = senses.group_of(parent)
            same_sense = meant == own if own else meant not in rivals
            if same_sense and parent not in collection.naming and fact.net >= MIN_VOTES_OF_KIND:
                found.add(parent)
    for group in collection.names.groups["supercategory"]:
        if group.iri in supercategories:
            found.update((reduced(name), "") for name in (group.label, *group.synonyms))
    return sorted(found)


def _near(collection: EdgeCollection, senses: SenseFilter, iri: str, keys: list[Key]) -> _Tallies:
    tallies: _Tallies = defaultdict(_Tally)
    for key in keys:
        for other, fact in sorted(collection.near.get(key, {}).items()):
            tallies[other].add(fact, senses.near(key, iri, other))
    return tallies


def _kinds(collection: EdgeCollection, senses: SenseFilter, iri: str, keys: list[Key]) -> _Tallies:
    """Supercategories of the category by IsA edges; without those of rival senses."""
    tallies: _Tallies = defaultdict(_Tally)
    own = senses.group(iri)
    for key in keys:
        for parent, fact in sorted(collection.is_a.get(key, {}).items()):
            target = collection.names.get(parent[0], "supercategory")
            if target is not None and own in (target, PLAIN):
                tallies[target].add(fact, 1.0)
    return tallies


def _enough(kind: str, tally: _Tally) -> bool:
    if kind == v.RDFS_SUB_CLASS_OF:  # a subclass has no probability, so it must not be disputed
        disputed = tally.against > MAX_DISPUTE * tally.votes
        return tally.votes >= MIN_VOTES_OF_SUBCLASS and not disputed
    return tally.votes - tally.against >= tally.least


def _found(kind: str, subject: str, target: str, tally: _Tally) -> ImportedRelation:
    weight = _weight(tally.votes)
    against = _weight(tally.against)
    ranked = sorted(tally.evidence.items(), key=lambda item: (-item[1][0], item[0]))[:MAX_SOURCES]
    return ImportedRelation(
        kind,
        subject,
        target,
        _probability(kind, weight - against),
        weight,
        against,
        tuple(source for source, _ in ranked),
        tuple(sorted({entry[2] for _, entry in ranked})),
        tuple(dict.fromkeys(entry[1] for _, entry in ranked)),
    )


def _probability(kind: str, net: float) -> float | None:
    if kind == v.RDFS_SUB_CLASS_OF:
        return None
    return round(probability_of(net, NEAR if kind == v.NEAR_BY else LOCATED), 3)


def _weight(votes: float) -> float:
    return round(weight_of(votes), 3)
