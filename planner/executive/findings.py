"""What a robot sees on a search becomes objects of the map, by the mapper's rules (section 3.3.1).

The robot says where each thing is; how far the map believes it follows as for a frame of a
recording: eq. 3.1 for what is seen, the mean of the positions, one number for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kg.others import PerceivedObjects
from kg.records import ObjectRecord, PlaceRecord
from kg.semantic_map import SemanticMap
from mapping.association import Sighting, associate, most_confident
from mapping.confidence import existence, lowered
from mapping.settings import ReferenceSettings
from mapping.sighted import first_seen, seen_again
from planner.executive.protocol import Detected

_NO_BOX = (0.0, 0.0, 0.0, 0.0)  # a robot tells positions, not pixels


@dataclass(frozen=True, slots=True)
class Seen:
    """What one message of detections means for the map."""

    objects: tuple[ObjectRecord, ...]  # as they are now, to be written
    new: tuple[str, ...]  # IRIs among them that the map did not have
    unknown: tuple[str, ...]  # labels that no category of objects carries


class Findings:
    """The objects of a map as a search goes on; what others write meanwhile is taken in."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._settings = ReferenceSettings()
        self._objects = PerceivedObjects(semantic_map)

    def category(self, label: str) -> str | None:
        """IRI of the category of objects called `label`, if there is one."""
        category = self._map.catalogue.get(label, kind="object")
        return category.iri if category else None

    def seen(self, things: Sequence[Detected], stamp: float) -> Seen:
        """Records of all that `things` show; what nobody knows the name of is left out."""
        self._objects.refresh()
        kappa = self._settings.kappa
        sightings, unknown = self._sightings(things)
        found = associate(sightings, tuple(self._objects.values()), kappa)
        places = self._map.places() if sightings else ()  # once: on a server it is a question
        records = [self._again(iri, s, stamp, places) for iri, s in found.matched.items()]
        new = [self._first(s, stamp, places) for s in most_confident(found.new, kappa)]
        for record in (*records, *new):
            self._objects[record.iri] = record
        return Seen((*records, *new), tuple(record.iri for record in new), unknown)

    def object_at(self, category: str, p_map: np.ndarray) -> str | None:
        """IRI of the object of `category` that a sighting at `p_map` (3,) [m] belongs to."""
        near = [
            (float(np.linalg.norm(record.p_map - p_map)), record.iri)
            for record in self._objects.values()
            if record.category == category
        ]
        metres, iri = min(near, default=(np.inf, None))
        return iri if metres < self._settings.kappa else None

    def of(self, categories: Sequence[str]) -> tuple[ObjectRecord, ...]:
        """The objects of these categories (IRIs), as they are now."""
        self._objects.refresh()
        return tuple(r for r in self._objects.values() if r.category in categories)

    def missed(self, record: ObjectRecord, times: int = 1) -> ObjectRecord | None:
        """`record` after `times` looks that should have shown it (eq. 3.4); None: it is gone."""
        confidence = record.confidence
        for _ in range(times):
            confidence = lowered(confidence, self._settings.xi)
        if confidence <= 0 and not self._said_to_be_there(record.iri):
            self._objects.pop(record.iri, None)
            return None
        confidence = max(confidence, 0.0)
        share = existence(confidence, self._settings.nu)
        after = replace(record, confidence=confidence, existence=share)
        self._objects[record.iri] = after
        return after

    def _sightings(self, things: Sequence[Detected]) -> tuple[list[Sighting], tuple[str, ...]]:
        sightings, unknown = [], []
        for thing in things:
            category = self.category(thing.label)
            if category is None:
                unknown.append(thing.label)
                continue
            p_map = np.array([thing.x, thing.y, thing.z])
            sightings.append(Sighting(category, thing.score, p_map, 0.0, _NO_BOX))
        return sightings, tuple(dict.fromkeys(unknown))

    def _again(
        self, iri: str, sighting: Sighting, stamp: float, places: Sequence[PlaceRecord]
    ) -> ObjectRecord:
        after = seen_again(self._objects[iri], sighting, stamp, self._settings)
        return replace(after, place=_place_of(after.p_map, places))

    def _first(
        self, sighting: Sighting, stamp: float, places: Sequence[PlaceRecord]
    ) -> ObjectRecord:
        record = first_seen(self._map.new_object_iri(), sighting, stamp, self._settings)
        return replace(record, place=_place_of(record.p_map, places))

    def _said_to_be_there(self, iri: str) -> bool:
        said = self._map.assertions(iri)
        return any(a.property == "existence" and a.value == "present" for a in said)


def _place_of(p_map: np.ndarray, places: Sequence[PlaceRecord]) -> str | None:
    x, y = float(p_map[0]), float(p_map[1])
    for place in places:
        if place.xmin <= x < place.xmax and place.ymin <= y < place.ymax:
            return place.iri
    return None
