"""What kind of place it is, told by the objects in it too.

The views of a place make the prior, the objects mapped in it the likelihood (`kg.placement`): each
kind of object counts as far as one of it is believed to exist there. What this map itself believes
of its places is no part of the table, or a place would confirm itself.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace

from kg.placement.table import PlacementTable, table_of
from kg.records import ObjectRecord, PlaceRecord
from kg.semantic_map import SemanticMap
from mapping.place_book import PlaceBook
from mapping.settings import ReferenceSettings

_Found = Mapping[str, float]  # category IRI -> probability that the place holds one


class PlacesFromObjects:
    """Lays the evidence of objects over what the views of each place say."""

    def __init__(
        self, semantic_map: SemanticMap, places: PlaceBook, settings: ReferenceSettings
    ) -> None:
        self._map, self._places, self._settings = semantic_map, places, settings
        self._catalogue = semantic_map.catalogue
        self._table: PlacementTable = table_of(semantic_map.ontology())
        self._done: dict[str, tuple[_Found, _Found, tuple[str, ...]]] = {}

    def step(self, objects: Iterable[ObjectRecord]) -> None:
        """Believe of every place what its views and the objects in it say, given all `objects`."""
        self._read_ontology_again()
        inside: dict[str, list[ObjectRecord]] = defaultdict(list)
        for record in objects:
            if record.place is not None and record.existence > 0:
                inside[record.place].append(record)
        for place in self._places.places():
            telling = [r for r in inside[place.iri] if r.category in self._table.objects]
            self._tell(place, telling)

    def _tell(self, place: PlaceRecord, telling: list[ObjectRecord]) -> None:
        if not telling:
            if place.told_by:
                alone = replace(place, beliefs=place.from_views, scene_beliefs={}, told_by=())
                self._places.put(alone)
            return
        found, told_by = found_in(telling), tuple(record.iri for record in telling)
        seen = place.from_views
        if place.told_by and self._done.get(place.iri) == (found, seen, told_by):
            return
        self._done[place.iri] = found, seen, told_by
        beliefs = self.fused(found, seen)
        self._places.put(replace(place, beliefs=beliefs, scene_beliefs=seen, told_by=told_by))

    def fused(self, found: _Found, seen: Mapping[str, float]) -> dict[str, float]:
        """p(category | views and objects) by IRI, of the categories worth keeping.

        Args:
            found: probability that the place holds an object of each category.
            seen: what the views make it believed to be; empty where there are none.
        """
        trust = self._settings.scene_trust
        total = sum(seen.values())
        prior = None
        if total > 0:  # a network knows few kinds of places, and objects may tell another
            share = (1 - trust) / len(self._table.places)
            prior = {c: trust * seen.get(c, 0.0) / total + share for c in self._table.places}
        weight = self._settings.objects_weight
        weighed = {category: weight * chance for category, chance in found.items()}
        told = self._table.place_posterior(weighed, prior=prior)
        return {c: p for c, p in told.items() if p >= self._settings.least_belief}

    def _read_ontology_again(self) -> None:
        if self._catalogue is not self._map.catalogue:
            self._catalogue = self._map.catalogue
            self._table = table_of(self._map.ontology())
            self._done.clear()


def found_in(objects: Iterable[ObjectRecord]) -> dict[str, float]:
    """Probability, in steps of 0.01, that at least one object of each category is there."""
    absent: dict[str, float] = {}
    for record in objects:
        chance = min(max(record.existence, 0.0), 1.0)
        absent[record.category] = absent.get(record.category, 1.0) * (1 - chance)
    return {category: round(1 - rest, 2) for category, rest in sorted(absent.items())}
