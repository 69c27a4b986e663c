"""Does a term mean our category, where it has other meanings too?

Where the source names the sense ("/c/en/mouse/n/wn/animal"), that decides. Elsewhere ("mouse" in
the attic) the meanings a term may have are read from what it IS said to be: our category belongs to
one group (its supercategory, or plain objects), a parent that belongs to another group is a rival
meaning. How often things of each group are said to be in that place then tells, by Bayes' rule,
which meaning the assertion speaks of:

    share = prior(own) p(place | own) / sum over meanings g of prior(g) p(place | g)

with prior by the votes of the parents, p(place | g) by the votes that things of group g are there,
both with a little added so that nothing is impossible.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from functools import cached_property
from typing import Final

from kg.conceptnet.collecting import Collection, Key

#: Added to every count of votes: of parents, and of things of a group in a place.
PARENT_PRIOR: Final = 1.0
USAGE_PRIOR: Final = 0.5
#: What puts a term into a group, or makes a rival meaning: one person's vote may be a slip.
FEWEST_RIVALS: Final = 2.0
#: The group of objects that have no supercategory.
PLAIN: Final = ""
#: WordNet's topics that fit a thing, and those that fit nothing else than the group named so.
_OF_THINGS: Final = frozenset({"artifact", "object", "tops"})
_MORE_TOPICS: Final = {"food": ("plant",)}  # a banana is also the herb it grows on


class Senses:
    """What a collection says of its terms' meanings; ask once all is collected.

    Args:
        collection: all facts.
        groups: IRI of every object category -> IRIs of its supercategories.
    """

    def __init__(self, collection: Collection, groups: Mapping[str, tuple[str, ...]]) -> None:
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

    def fits(self, category: str, topic: str) -> bool:
        """Whether WordNet's topic of a term can be that of an object category."""
        named = self._labels[category] | self._labels.get(self.group(category), set())
        wanted = {more for name in named for more in (name, *_MORE_TOPICS.get(name, ()))}
        living = wanted & {"animal", "food", "person"}
        return topic in wanted if living else topic in wanted | _OF_THINGS

    def at_place(self, key: Key, category: str, place: str) -> float:
        """The share, 0..1, of "`key` is in `place`" that speaks of the category."""
        weights = {
            group: prior * self._usage(group, place)
            for group, prior in self._priors(key, category).items()
        }
        return weights[self.group(category)] / sum(weights.values())

    def near(self, key: Key, category: str, other: str) -> float:
        """The share of "`key` is near `other`" that speaks of the category.

        All of it where the other is of the category's group; none where it is of a rival's.
        """
        priors = self._priors(key, category)
        other_group = self.group(other)
        if other_group == self.group(category) or len(priors) == 1:
            return 1.0
        if other_group in priors and other_group != PLAIN:
            return 0.0
        return priors[self.group(category)] / sum(priors.values())

    def rivals(self, key: Key, category: str) -> frozenset[str]:
        """Groups that the term may mean instead of the category's own."""
        return frozenset(self._priors(key, category)) - {self.group(category)}

    def group_of(self, key: Key, depth: int = 1) -> str | None:
        """The group most of a term's votes put it into, over so many further IsA; None: unknown."""
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
        return best if votes.get(best, 0.0) >= FEWEST_RIVALS else None

    def _priors(self, key: Key, category: str) -> dict[str, float]:
        """How much each meaning of a term weighs before its place is known."""
        own = self.group(category)
        if key[1]:  # the source says which sense is meant
            return {own: 1.0}
        votes: dict[str, float] = defaultdict(float)
        for parent, fact in self._collection.is_a.get(key, {}).items():
            group = self.group_of(parent)
            if group is not None and fact.net > 0:
                votes[group] += fact.net
        rivals = {g: n for g, n in votes.items() if g != own and n >= FEWEST_RIVALS}
        return {own: votes[own] + PARENT_PRIOR, **rivals}

    def _usage(self, group: str, place: str) -> float:
        counts = self._counts[group]
        places = len(self._collection.names.groups["place"])
        total = sum(counts.values())
        return (counts[place] + USAGE_PRIOR) / (total + USAGE_PRIOR * places)

    @cached_property
    def _counts(self) -> dict[str, dict[str, float]]:
        """Group -> place -> votes that things of the group are there, unclear terms left out."""
        counts: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
        for key, facts in self._collection.at_place.items():
            group = self.group_of(key)
            category = self._collection.naming.get(key)
            if group is None or (category and len(self._priors(key, category)) > 1):
                continue
            for place, fact in facts.items():
                counts[group][place] += max(fact.net, 0.0)
        return counts
