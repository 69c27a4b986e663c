"""Room counts of a map: rooms with an object, and rooms searched without finding it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from kg.knowledge.placement.belief_model import Matrix
from kg.knowledge.placement.settings import HALF_SEARCHED_VIEWS, MIN_VIEWS
from kg.model.records import ObjectRecord, PlaceRecord


@dataclass(frozen=True, slots=True)
class MapCounts:
    """Beliefs about the r places of a map: their categories and the objects they hold."""

    kind: Matrix  # (r, m) belief in each place category
    holds: Matrix  # (r, n) probability that the place holds an object of each kind
    searched: Matrix  # (r, n) fraction of the place that was searched for each kind, 0..1

    @property
    def with_object(self) -> Matrix:
        """(n, m) expected number of rooms of each kind with each object."""
        return np.asarray(self.holds.T @ self.kind)

    @property
    def without_object(self) -> Matrix:
        """(n, m) expected number of rooms of each kind searched without finding the object."""
        return np.asarray(((1 - self.holds) * self.searched).T @ self.kind)

    def near(self, row: int, other: int) -> tuple[float, float]:
        """Expected number of rooms with `other` and with, or without, the object `row`."""
        with_other = self.holds[:, other]
        without = (1 - self.holds[:, row]) * self.searched[:, row]
        return float(with_other @ self.holds[:, row]), float(with_other @ without)


def searched_fraction(views: int) -> float:
    """Fraction of a place, 0..1, that counts as searched after `views` scene categorisations."""
    return views / (views + HALF_SEARCHED_VIEWS) if views >= MIN_VIEWS else 0.0


def map_counts(
    places: Iterable[PlaceRecord],
    records: Iterable[ObjectRecord],
    objects: Mapping[str, int],
    columns: Mapping[str, int],
    above: Mapping[str, tuple[str, ...]],
    sought: Collection[str] | None = None,
) -> MapCounts:
    """Room counts of a map's records, with the numbers of objects and places by IRI.

    A place counts for each category in proportion to its belief. It holds an object with the
    probability that at least one object of the category, or of a subcategory, exists there. It was
    searched for the objects with IRIs in `sought` (None: for all).
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
    share = np.array([searched_fraction(room.views) for room in rooms])
    mask = [float(sought is None or iri in sought) for iri in objects]
    return MapCounts(kind, 1 - absent, share.reshape(-1, 1) * np.array(mask))
