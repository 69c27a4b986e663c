"""Word sense disambiguation: the probability that a term of an edge means a category.

A sense stated by the source ("/c/en/mouse/n/wn/animal") is used. Otherwise ("mouse" in the attic)
the senses of a term follow from its IsA edges: the category belongs to one group (its
supercategory, or plain objects), and a parent of another group is a rival sense. The frequency of
each group in that place gives the probability of each sense by Bayes' rule:

    share = prior(own) p(place | own) / sum over meanings g of prior(g) p(place | g)

with the prior from the votes of the parents and p(place | g) from the votes for group g in that
place, both with additive smoothing. For a part of a whole (a mouse of a computer), p(place | own)
comes from the places of the whole.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from functools import cached_property
from typing import Final

from kg.knowledge.conceptnet.collecting import EdgeCollection, Key

#: Additive smoothing of vote counts: of parents, and of a group in a place.
PARENT_PRIOR: Final = 1.0
USAGE_PRIOR: Final = 0.5
#: Minimum votes for membership in a group or for a rival sense: a single vote may be an error.
MIN_RIVAL_VOTES: Final = 2.0
#: The group of objects without a supercategory.
PLAIN: Final = ""
#: WordNet's topics of inanimate objects, and further topics of a named group.
_OF_THINGS: Final = frozenset({"artifact", "object", "tops"})
_MORE_TOPICS: Final = {"food": ("plant",)}  # a banana is also the herb it grows on


class SenseFilter:
    """Sense disambiguation over a complete collection.

    Args:
        collection: all facts.
        groups: IRI of every object category -> IRIs of its supercategories.
    """

    def __init__(self, collection: EdgeCollection, groups: Mapping[str, tuple[str, ...]]) -> None:
        self._collection = collection
        self._groups = groups
        self._labels = {
            c.iri: {word for name in (c.label, *c.synonyms) for word in name.casefold().split()}
            for kind in ("object", "supercategory")
            for c in collection.names.groups[kind]
        }

    def group(self, category: str) -> str:
        """The group of an object category: the IRI of its supercategory, or `PLAIN`."""
        return next(iter(self._groups.get(category, ())), PLAIN)

    def divided(self, parent: Key, category: str) -> bool:
        """Whether a parent of a category is rather one of things of another named group.

        Bottles and boats are vessels, so vessels in the ocean need not be bottles.
        """
        votes = self._children[parent]
        own = self.group(category)
        return any(n >= votes[own] for group, n in votes.items() if group not in (own, PLAIN))

    def is_animal(self, category: str) -> bool:
        """Whether an object category is in the group of animals."""
        return "animal" in self._labels.get(self.group(category), ())

    def fits(self, category: str, topic: str) -> bool:
        """Whether WordNet's topic of a term can be that of an object category."""
        named = self._labels[category] | self._labels.get(self.group(category), set())
        wanted = {more for name in named for more in (name, *_MORE_TOPICS.get(name, ()))}
        living = wanted & {"animal", "food", "person"}
        return topic in wanted if living else topic in wanted | _OF_THINGS

    def at_place(self, key: Key, category: str, place: str) -> float:
        """Probability, 0..1, that "`key` is in `place`" is about the category."""
        weights = {
            group: prior * self._usage(group, place)
            for group, prior in self._priors(key, category).items()
        }
        own = self.group(category)
        if len(weights) > 1 and (counts := self._of_wholes(key)):
            share = counts.get(place, 0.0) / sum(counts.values())
            weights[own] = self._priors(key, category)[own] * share
        return weights[own] / sum(weights.values())

    def near(self, key: Key, category: str, other: str) -> float:
        """Probability, 0..1, that "`key` is near `other`" is about the category.

        It is 0 for another object of a rival's group or an animal ("at a bear" means inside of it),
        and 1 for another object of the category's own group, unless the term is part of a whole:
        parts of a computer are not near a refrigerator.
        """
        priors, own, others = self._priors(key, category), self.group(category), self.group(other)
        if others != own and self.is_animal(other):
            return 0.0
        if others == own and not self._of_wholes(key):
            return 1.0
        if others in priors and others not in (own, PLAIN):
            return 0.0
        return priors[own] / sum(priors.values())

    def rivals(self, key: Key, category: str) -> frozenset[str]:
        """Groups of the rival senses of a term."""
        return frozenset(self._priors(key, category)) - {self.group(category)}

    def group_of(self, key: Key, depth: int = 1) -> str | None:
        """Group of a term by majority vote, over up to `depth` further IsA edges; None: unknown."""
        if (own := self._collection.names.get(key[0], "supercategory")) is not None:
            return own
        if (category := self._collection.naming.get(key)) is not None:
            return self.group(category)
        if depth < 0:
            return None
        votes: dict[str, float] = defaultdict(float)
        for parent, fact in self._collection.is_a.get(key, {}).items():
            group = self._collection.names.get(parent[0], "supercategory")
            if group is None and depth:
                group = self.group_of(parent, 0)
            if group is not None and fact.net > 0:
                votes[group] += fact.net
        best = max(sorted(votes), key=votes.__getitem__, default="")
        return best if votes.get(best, 0.0) >= MIN_RIVAL_VOTES else None

    def _priors(self, key: Key, category: str) -> dict[str, float]:
        """Prior weight of each sense of a term."""
        own = self.group(category)
        if key[1]:  # the source states the sense
            return {own: 1.0}
        votes: dict[str, float] = defaultdict(float)
        for parent, fact in self._collection.is_a.get(key, {}).items():
            group = self.group_of(parent)
            if group is not None and fact.net > 0:
                votes[group] += fact.net
        rivals = {g: n for g, n in votes.items() if g != own and n >= MIN_RIVAL_VOTES}
        return {own: votes[own] + PARENT_PRIOR, **rivals}

    def _of_wholes(self, key: Key) -> dict[str, float]:
        """Place -> votes, over the wholes that have the term as a part."""
        counts: dict[str, float] = defaultdict(float)
        for whole, link in self._collection.part_of.get(key, {}).items():
            if link.net >= MIN_RIVAL_VOTES:
                for place, fact in self._collection.at_place.get(whole, {}).items():
                    if fact.net >= MIN_RIVAL_VOTES:
                        counts[place] += fact.net
        return counts

    def _usage(self, group: str, place: str) -> float:
        counts = self._counts[group]
        places = len(self._collection.names.groups["place"])
        total = sum(counts.values())
        return (counts[place] + USAGE_PRIOR) / (total + USAGE_PRIOR * places)

    @cached_property
    def _children(self) -> dict[Key, dict[str, float]]:
        """Parent -> group -> votes of IsA edges that put categories of it below the parent."""
        votes: dict[Key, dict[str, float]] = defaultdict(lambda: defaultdict(float))
        for key, iri in self._collection.naming.items():
            for parent, fact in self._collection.is_a.get(key, {}).items():
                votes[parent][self.group(iri)] += max(fact.net, 0.0)
        return votes

    @cached_property
    def _counts(self) -> dict[str, dict[str, float]]:
        """Group -> place -> votes, without ambiguous terms."""
        counts: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
        for key, facts in self._collection.at_place.items():
            group = self.group_of(key)
            category = self._collection.naming.get(key)
            if group is None or (category and len(self._priors(key, category)) > 1):
                continue
            for place, fact in facts.items():
                counts[group][place] += max(fact.net, 0.0)
        return counts
