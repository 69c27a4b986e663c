"""Plausibility of relations: what votes support, and other relations of the import contradict.

People also say what is alike ("zebra near horse"), what is made of a thing ("cow at the butcher's
shop") and what they once saw ("car in a museum"). Such statements have a few votes each, so a
threshold of votes that excludes them would exclude most true ones too. The rules look at the other
relations of the import instead:

- things are near each other if they have a place in common. Without one, or where the import has
  no place of one of them, two votes are needed, and members of one group (zebra, horse) are alike
  rather than near;
- an animal in a shop or where meals are served is its meat;
- a single vote does not bring a thing of the open into a room, nor a thing of rooms into the open.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Final

from kg.knowledge.conceptnet.names import TermMatcher
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
