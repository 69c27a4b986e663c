"""What this very map has seen: rooms that hold an object, rooms that were looked at and do not."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from kg.placement.model import Matrix
from kg.placement.settings import HALF_SEEN, LEAST_VIEWS
from kg.records import ObjectRecord, PlaceRecord


@dataclass(frozen=True, slots=True)
class SeenRooms:
    """r places of a map: what they are believed to be, and to hold."""

    kind: Matrix  # (r, m) belief in each place category
    holds: Matrix  # (r, n) probability that it holds an object of each kind
    looked: Matrix  # (r, n) how much of it was searched for each kind, 0..1

    @property
    def with_object(self) -> Matrix:
        """(n, m) expected number of rooms of each kind that hold each object."""
        return np.asarray(self.holds.T @ self.kind)

    @property
    def without_object(self) -> Matrix:
        """(n, m) expected number of rooms searched in vain."""
        return np.asarray(((1 - self.holds) * self.looked).T @ self.kind)

    def near(self, row: int, other: int) -> tuple[float, float]:
        """Expected number of rooms with `other` that hold object `row`, and that do not."""
        there = self.holds[:, other]
        without = (1 - self.holds[:, row]) * self.looked[:, row]
        return float(there @ self.holds[:, row]), float(there @ without)


def seen_share(views: int) -> float:
    """How much of a place counts as looked at after so many scene categorisations, 0..1."""
    return views / (views + HALF_SEEN) if views >= LEAST_VIEWS else 0.0


def seen_rooms(
    places: Iterable[PlaceRecord],
    records: Iterable[ObjectRecord],
    objects: Mapping[str, int],
    columns: Mapping[str, int],
    above: Mapping[str, tuple[str, ...]],
    sought: Collection[str] | None = None,
) -> SeenRooms:
    """What a map's records say; rows of `objects`, columns of `columns`, both by IRI.

    A place speaks for each category as much as it is believed to be of it. It holds an object with
    the probability that at least one of that category, or of one below it, exists there. It was
    searched for the objects whose IRIs are in `sought` (None: for all).
    """
    rooms = tuple(places)
    number = {room.iri: n for n, room in enumerate(rooms)}
    kind = np.zeros((len(rooms), len(columns)))
    for n, room in enumerate(rooms):
        for iri, belief in room.beliefs.items():
            if iri in columns:
                kind[n, columns[iri]] = min(max(belief, 0.0), 1.0)
    absent = np.ones((len(rooms), len(objects)))
    for record in records:
        if record.place in number:
            for iri in above.get(record.category, (record.category,)):
                if iri in objects:
                    absent[number[record.place], objects[iri]] *= 1 - record.existence
    share = np.array([seen_share(room.views) for room in rooms])
    mask = [float(sought is None or iri in sought) for iri in objects]
    return SeenRooms(kind, 1 - absent, share.reshape(-1, 1) * np.array(mask))
