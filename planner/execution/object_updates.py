"""Object updates from a robot's detections: the mapper's own rules, on positions in the map."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.records import ObjectRecord
from mapping.label_resolver import LabelResolver
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.object_mapper import ObjectChanges
from mapping.places.place_registry import PlaceRegistry
from mapping.relations.relation_mapper import RelationMapper
from mapping.sighting import Sighting as MappedSighting
from planner.execution.protocol import Detected, RobotPose


@dataclass(frozen=True, slots=True)
class AssociatedDetection:
    """A robot's detection and the object of the map that it was associated with."""

    thing: Detected
    category: str  # IRI: the object's, assertions applied; the label's where there is no object
    iri: str | None  # of the object
    existence: float  # of the object, with this detection; 0 where there is none


@dataclass(frozen=True, slots=True)
class DetectionUpdate:
    """Effect of one message of detections on the map."""

    updated: tuple[ObjectRecord, ...]  # to be written
    removed: tuple[str, ...]  # IRIs of objects that others have absorbed
    detections: tuple[AssociatedDetection, ...]  # of known labels
    unknown: tuple[str, ...]  # labels that no category of objects has


class ObjectUpdates:
    """Objects of a map during a search, updated by `mapping`'s object mapper; writes nothing."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        places = PlaceRegistry(semantic_map, recording=None)
        self._mapper = BayesObjectMapper(semantic_map, places=places)
        self._relations = RelationMapper(semantic_map, self._mapper.cache)
        self._labels = LabelResolver(semantic_map, "object")

    def add(self, things: Sequence[Detected], stamp: float, pose: RobotPose) -> DetectionUpdate:
        """Associate detections, taken at `stamp` [s since 1970] from `pose`, with objects."""
        named = [(thing, self._labels.category(thing.label)) for thing in things]
        sightings = [
            (thing, MappedSighting(category, thing.score, np.array([thing.x, thing.y, thing.z])))
            for thing, category in named
            if category is not None
        ]
        found = self._mapper.add_sightings(
            [sighting for _, sighting in sightings], stamp, robot=np.array([pose.x, pose.y])
        )
        changes = self._relations.update(found)
        detections = tuple(self._associated(thing, sighting) for thing, sighting in sightings)
        unknown = dict.fromkeys(thing.label for thing, category in named if category is None)
        return DetectionUpdate(changes.updated, changes.removed, detections, tuple(unknown))

    def of(self, categories: Collection[str]) -> tuple[ObjectRecord, ...]:
        """Objects of these categories (IRIs) at present, assertions applied."""
        self._mapper.refresh()
        return tuple(r for r in self._mapper.objects() if r.category in categories)

    def decay(self, iri: str, times: int = 1, recall: float | None = None) -> ObjectChanges:
        """Changes after `times` looks that should have shown the object and did not.

        `recall` is the chance that such a look shows it; the detector's greatest by default.
        """
        return self._relations.update(self._mapper.decay(iri, times, recall))

    def _associated(self, thing: Detected, sighting: MappedSighting) -> AssociatedDetection:
        iri = self._mapper.object_of(sighting)
        record = None if iri is None else self._mapper.get(iri)
        category = sighting.category if record is None else record.category
        existence = 0.0 if record is None else record.existence
        return AssociatedDetection(thing, category, iri, existence)
