"""Object evidence for place categories: Bayes' rule with the objects in each place.

The views of a place make the prior, the objects mapped in it the likelihood
(`kg.knowledge.placement`): each kind of object counts as far as one of it is believed to exist
there. The table leaves out this map's own beliefs about its places, or a place would confirm
itself.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace

from kg.knowledge.placement.table import PlacementTable, table_of
from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord, PlaceRecord
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import ReferenceSettings

_Presence = Mapping[str, float]  # category IRI -> probability that the place holds one


class ObjectEvidence:
    """Fuses the evidence of objects with the beliefs that the views of each place give."""

    def __init__(
        self, semantic_map: SemanticMap, places: PlaceRegistry, settings: ReferenceSettings
    ) -> None:
        self._map, self._places, self._settings = semantic_map, places, settings
        self._catalogue = semantic_map.catalogue
        self._table: PlacementTable = table_of(semantic_map.ontology.quads())
        self._frequencies = self._table.room_frequencies
        self._done: dict[str, tuple[_Presence, _Presence, tuple[str, ...]]] = {}

    def update(self, objects: Iterable[ObjectRecord]) -> None:
        """Update the belief of every place from its views and from all `objects` in it."""
        self._refresh_ontology()
        inside: dict[str, list[ObjectRecord]] = defaultdict(list)
        for record in objects:
            if record.place is not None and record.existence > 0:
                inside[record.place].append(record)
        for place in self._places.places():
            evidence = [r for r in inside[place.iri] if r.category in self._table.objects]
            self._fuse(place, evidence)

    def _fuse(self, place: PlaceRecord, evidence: list[ObjectRecord]) -> None:
        if not evidence:
            if place.evidence_objects:
                alone = replace(
                    place, beliefs=place.from_views, scene_beliefs={}, evidence_objects=()
                )
                self._places.put(alone)
            return
        present, objects = presence(evidence), tuple(record.iri for record in evidence)
        views = place.from_views
        if place.evidence_objects and self._done.get(place.iri) == (present, views, objects):
            return
        self._done[place.iri] = present, views, objects
        beliefs = self.fused(present, views)
        self._places.put(
            replace(place, beliefs=beliefs, scene_beliefs=views, evidence_objects=objects)
        )

    def fused(self, present: _Presence, views: Mapping[str, float]) -> dict[str, float]:
        """Posterior p(category | views and objects) by IRI, of the categories worth keeping.

        Args:
            present: probability that the place holds an object of each category.
            views: belief from the views; empty where there are none.
        """
        prior = self.prior(views)
        weight = self._settings.objects_weight
        weighed = {category: weight * chance for category, chance in present.items()}
        posterior = self._table.place_posterior(weighed, prior=prior)
        return {c: p for c, p in posterior.items() if p >= self._settings.least_belief}

    def prior(self, views: Mapping[str, float]) -> dict[str, float]:
        """Prior probability of each category IRI from views and room frequencies; sums to 1.

        Without views the frequencies alone. With them, a share of the views' belief is left to the
        frequencies, since a network has few place categories, and the rest is weighed by them.
        """
        s, frequency = self._settings, self._frequencies
        total = sum(views.values())
        if total <= 0:
            return dict(frequency)
        weighed = {
            c: (s.scene_trust * views.get(c, 0.0) / total + (1 - s.scene_trust) * f)
            * f**s.frequency_weight
            for c, f in frequency.items()
        }
        whole = sum(weighed.values())
        return {c: p / whole for c, p in weighed.items()}

    def _refresh_ontology(self) -> None:
        if self._catalogue is not self._map.catalogue:
            self._catalogue = self._map.catalogue
            self._table = table_of(self._map.ontology.quads())
            self._frequencies = self._table.room_frequencies
            self._done.clear()


def presence(objects: Iterable[ObjectRecord]) -> dict[str, float]:
    """Presence probability of each category, in steps of 0.01: at least one object is there."""
    absent: dict[str, float] = {}
    for record in objects:
        chance = min(max(record.existence, 0.0), 1.0)
        absent[record.category] = absent.get(record.category, 1.0) * (1 - chance)
    return {category: round(1 - rest, 2) for category, rest in sorted(absent.items())}
