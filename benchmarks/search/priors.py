"""Priors of a search in a home: probabilities of rooms, and the thesis' listed rooms.

With statistics of real homes, those of the home to be searched are taken out first, so that no
home tells where its own things are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.search.homes import Home
from benchmarks.search.room_beliefs import RoomChances
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies, superclasses
from kg.knowledge.ontology.relations import relations
from kg.knowledge.placement.statistics import (
    RoomStatistics,
    RoomTable,
    read_rooms,
    room_type_quads,
    statistics_quads,
)
from kg.knowledge.placement.surveys import RoomType, room_types
from kg.knowledge.placement.table import PlacementTable, table_of
from kg.model import vocabulary as v


@dataclass(frozen=True, slots=True)
class Prior:
    """Of one kind of object in one home."""

    chances: RoomChances  # that the rooms hold at least one
    listed: tuple[bool, ...]  # (rooms,) whether the thesis' ontology puts it there


class PriorKnowledge:
    """The shipped ontology, and statistics of rooms (CSV) where they are given.

    `apart` says that the statistics did not count the homes. Raises InvalidFactError for a CSV that
    is none (`kg.knowledge.placement.statistics.read_rooms`).
    """

    def __init__(self, homes: Sequence[Home], rooms: Path | None = None, *, apart: bool = False):
        quads = tuple(load_ontologies().quads)
        self._catalogue = Catalogue.from_quads(quads)
        self._above = superclasses(quads)
        self._listed = {(r.subject, r.target) for r in relations(quads) if r.kind == v.LOCATED_AT}
        table = read_rooms(rooms, self._catalogue, "rooms of homes") if rooms else None
        names = {room.label for home in homes for room in home.rooms}
        self._kinds = {name: room_types(name, self._catalogue) for name in names}
        types = {kind for kinds in self._kinds.values() for kind in kinds if kind.below}
        self._quads = (*quads, *room_type_quads(types | set(table.new_types if table else ())))
        self._table, self._apart = table, apart

    def knows(self, kind: str) -> bool:
        """Whether there is such a kind of object."""
        return self._catalogue.get(kind, "object") is not None

    def priors(self, home: Home) -> dict[str, Prior]:
        """For every kind of object the home holds and the ontology knows."""
        table = self._placement(home)
        return {kind: self._prior(home, kind, table) for kind in home.objects if self.knows(kind)}

    def _placement(self, home: Home) -> PlacementTable:
        if self._table is None:
            return table_of(self._quads)
        counted = self._table if self._apart else self._without(home, self._table)
        return table_of((*self._quads, *statistics_quads(counted.statistics)))

    def _without(self, home: Home, table: RoomTable) -> RoomTable:
        rooms: Counter[str] = Counter()
        held: Counter[tuple[str, str]] = Counter()
        for room in home.rooms:
            kinds = self._kinds[room.label]
            if len(kinds) != 1:
                continue
            rooms[kinds[0].iri] += 1
            found = {self._catalogue.get(kind, "object") for kind in room.holds}
            held.update((kinds[0].iri, thing.iri) for thing in found if thing)
        left = (
            _less(one, rooms[one.place], held[one.place, one.object]) for one in table.statistics
        )
        return replace(table, statistics=tuple(one for one in left if one.rooms > 0))

    def _prior(self, home: Home, kind: str, table: PlacementTable) -> Prior:
        thing = self._catalogue.find(kind, "object").iri
        kinds = [self._kinds[room.label] for room in home.rooms]
        chances = RoomChances(
            np.array([_chance(table, thing, of) for of in kinds]),
            tuple(" ".join(sorted(kind.iri for kind in of)) for of in kinds),
            np.array([_worth(table, thing, of) for of in kinds]),
        )
        return Prior(chances, tuple(self._lists(thing, of) for of in kinds))

    def _lists(self, thing: str, kinds: Sequence[RoomType]) -> bool:
        things = self._above.get(thing, (thing,))
        places = {up for kind in kinds for up in self._above.get(kind.iri, (kind.iri, kind.below))}
        return any((a, b) in self._listed for a in things for b in places)


def _chance(table: PlacementTable, thing: str, kinds: Sequence[RoomType]) -> float:
    """A room that is two kinds holds what either would."""
    if not kinds:
        return table.probability(thing, v.PLACE)
    return float(1 - np.prod([1 - table.probability(thing, kind.iri) for kind in kinds]))


def _worth(table: PlacementTable, thing: str, kinds: Sequence[RoomType]) -> float:
    known = [table.placement(thing, iri) for iri in [kind.iri for kind in kinds] or [v.PLACE]]
    return min(one.alpha + one.beta for one in known)


def _less(one: RoomStatistics, rooms: int, held: int) -> RoomStatistics:
    left = max(one.rooms - rooms, 0)
    return replace(one, rooms=left, rooms_with=min(max(one.rooms_with - held, 0), left))
