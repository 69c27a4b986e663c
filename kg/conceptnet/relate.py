"""Facts about terms weighed into relations between our categories."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from kg import vocabulary as v
from kg.conceptnet.collecting import Collection, Fact, Key
from kg.conceptnet.names import reduced
from kg.conceptnet.senses import PLAIN, Senses
from kg.conceptnet.strength import (
    NEAR_HALF,
    NEAR_STEEPNESS,
    probability_of,
    weight_of,
)

#: A name that may as well mean something else (a synonym, "notebook"), beside one that is ours.
DOUBTFUL_SHARE: Final = 0.5
#: What is said of a kind (fruit), beside what is said of the thing itself (banana).
INHERITED_SHARE: Final = 0.25
#: Votes: what a relation needs, what a kind needs to pass anything on, what makes a subclass.
FEWEST_VOTES: Final = 1.0
FEWEST_FOR_KIND: Final = 2.0
FEWEST_FOR_SUBCLASS: Final = 2.0
#: Votes against, as a share of those for, that a subclass bears.
MOST_DISPUTE: Final = 0.25
#: The strongest so many assertions are named as sources.
MOST_SOURCES: Final = 5


@dataclass(frozen=True, slots=True)
class Found:
    """A relation between two of our categories, with what speaks for and against it."""

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
    """Votes for and against, with who cast them."""

    votes: float = 0.0
    against: float = 0.0
    voices: dict[str, tuple[float, str, str]] = field(default_factory=dict)

    def add(self, fact: Fact, share: float) -> None:
        self.votes += fact.votes() * share
        self.against += fact.votes(negated=True) * share
        for (source, _), voice in fact.voices.items():
            weighed = (voice.votes * share, voice.surface, voice.license)
            self.voices[source] = max(self.voices.get(source, (0.0, "", "")), weighed)


_Tallies = dict[str, _Tally]


def relate(
    collection: Collection, groups: Mapping[str, tuple[str, ...]]
) -> tuple[tuple[Found, ...], int]:
    """The relations a collection supports, sorted; and how many more are outvoted or too weak.

    Args:
        collection: all facts.
        groups: IRI of every object category -> IRIs of its supercategories.
    """
    senses = Senses(collection, groups)
    tallied = [
        (kind, subject, target, tally)
        for kind, subject, tallies in _tallied(collection, senses, groups)
        for target, tally in tallies.items()
        if target != subject
    ]
    found = [_found(*each) for each in tallied if _enough(each[0], each[3])]
    return tuple(sorted(found, key=_order)), len(tallied) - len(found)


def _order(found: Found) -> tuple[str, str, str]:
    return found.kind, found.subject, found.target


def _tallied(
    collection: Collection, senses: Senses, groups: Mapping[str, tuple[str, ...]]
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
    collection: Collection,
    senses: Senses,
    iri: str,
    keys: list[Key],
    supercategories: Iterable[str],
) -> _Tallies:
    tallies: _Tallies = defaultdict(_Tally)
    for key in keys:
        for place, fact in sorted(collection.at_place.get(key, {}).items()):
            tallies[place].add(fact, senses.at_place(key, iri, place))
    for key in _doubtful(collection, iri, keys):
        for place, fact in sorted(collection.at_place.get(key, {}).items()):
            tallies[place].add(fact, DOUBTFUL_SHARE * senses.at_place(key, iri, place))
    parents = _parents(collection, senses, iri, keys, supercategories)
    strongest: dict[str, Fact] = {}
    for parent in parents:
        for place, fact in sorted(collection.at_place.get(parent, {}).items()):
            if place not in strongest or fact.net > strongest[place].net:
                strongest[place] = fact
    for place, fact in strongest.items():
        tallies[place].add(fact, INHERITED_SHARE)
    return tallies


def _doubtful(collection: Collection, iri: str, keys: list[Key]) -> list[Key]:
    """Terms that may mean the category: known ones, and synonyms that name no other."""
    found = {key for key in collection.at_place if collection.names.doubtful(key[0]) == iri}
    for key in keys:
        for other, fact in collection.same_as.get(key, {}).items():
            if fact.net > 0 and other not in collection.naming:
                found.add(other)
    return sorted(found)


def _parents(
    collection: Collection,
    senses: Senses,
    iri: str,
    keys: list[Key],
    supercategories: Iterable[str],
) -> list[Key]:
    """What the category is, as its own terms and the ontology say; not its rival meanings."""
    found: set[Key] = set()
    for key in keys:
        rivals = senses.rivals(key, iri)
        for parent, fact in collection.is_a.get(key, {}).items():
            mine = parent not in collection.naming and senses.group_of(parent) not in rivals
            if mine and fact.net >= FEWEST_FOR_KIND:
                found.add(parent)
    for group in collection.names.groups["supercategory"]:
        if group.iri in supercategories:
            found.update((reduced(name), "") for name in (group.label, *group.synonyms))
    return sorted(found)


def _near(collection: Collection, senses: Senses, iri: str, keys: list[Key]) -> _Tallies:
    tallies: _Tallies = defaultdict(_Tally)
    for key in keys:
        for other, fact in sorted(collection.near.get(key, {}).items()):
            tallies[other].add(fact, senses.near(key, iri, other))
    return tallies


def _kinds(collection: Collection, senses: Senses, iri: str, keys: list[Key]) -> _Tallies:
    """Supercategories the category is said to be one of; a rival meaning's are not taken."""
    tallies: _Tallies = defaultdict(_Tally)
    own = senses.group(iri)
    for key in keys:
        for parent, fact in sorted(collection.is_a.get(key, {}).items()):
            target = collection.names.get(parent[0], "supercategory")
            if target is not None and own in (target, PLAIN):
                tallies[target].add(fact, 1.0)
    return tallies


def _enough(kind: str, tally: _Tally) -> bool:
    if kind == v.RDFS_SUB_CLASS_OF:  # all or nothing, so no dispute
        disputed = tally.against > MOST_DISPUTE * tally.votes
        return tally.votes >= FEWEST_FOR_SUBCLASS and not disputed
    return tally.votes - tally.against >= FEWEST_VOTES


def _found(kind: str, subject: str, target: str, tally: _Tally) -> Found:
    weight = _weight(tally.votes)
    against = _weight(tally.against)
    ranked = sorted(tally.voices.items(), key=lambda item: (-item[1][0], item[0]))[:MOST_SOURCES]
    return Found(
        kind,
        subject,
        target,
        _probability(kind, weight - against),
        weight,
        against,
        tuple(source for source, _ in ranked),
        tuple(sorted({voice[2] for _, voice in ranked})),
        tuple(dict.fromkeys(voice[1] for _, voice in ranked)),
    )


def _probability(kind: str, net: float) -> float | None:
    if kind == v.RDFS_SUB_CLASS_OF:
        return None
    near = {"half": NEAR_HALF, "steepness": NEAR_STEEPNESS} if kind == v.NEAR_BY else {}
    return round(probability_of(net, **near), 3)


def _weight(votes: float) -> float:
    return round(weight_of(votes), 3)
