"""Object updates from a search: pictures are mapped as a recording's, else positions are.

Objects that a look should have shown and did not lose existence. Objects related to a target call
for a new plan.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.object_mapper import ObjectChanges
from mapping.places.place_registry import PlaceRegistry
from mapping.relations.relation_mapper import RelationMapper
from mapping.sighting import Sighting, ThingSighting
from planner.execution.protocol import Detected, DetectionsMessage, RobotPose, View
from planner.execution.search_log import SearchLog
from planner.execution.viewpoint_adapter import ViewpointAdapter
from planner.search.goals.targets import Target


@dataclass(frozen=True, slots=True)
class AssociatedDetection:
    """A robot's detection and the object of the map that it was associated with."""

    thing: Detected
    category: str  # IRI: the object's, assertions applied; the label's where there is no object
    iri: str | None  # of the object; None of a candidate, which is none yet
    existence: float  # of the object or candidate, with this detection


@dataclass(frozen=True, slots=True)
class DetectionUpdate:
    """Effect of one message of detections on the map."""

    changes: ObjectChanges  # to be written
    detections: tuple[AssociatedDetection, ...]  # of known labels
    unknown: tuple[str, ...]  # labels so far that no category of objects has

    @property
    def shown(self) -> frozenset[str]:
        """IRIs of the objects that were detected."""
        return frozenset(one.iri for one in self.detections if one.iri is not None)


_Seen = tuple[Detected, str, Sighting | ThingSighting]  # with its category's IRI


class ObjectUpdates:
    """Objects of a map during a search, updated by `mapping`'s object mapper; writes nothing.

    Observations name `recording`, which is the search, and the robot's `detector`.
    """

    def __init__(
        self, semantic_map: SemanticMap, recording: str = "search", detector: str = ""
    ) -> None:
        places = PlaceRegistry(semantic_map, recording=None)
        self._mapper = BayesObjectMapper(
            semantic_map, places=places, recording=recording, model=detector
        )
        self._relations = RelationMapper(semantic_map, self._mapper.cache)
        self._map = semantic_map
        self._has_views = False

    def add(self, message: DetectionsMessage, stamp: float, pose: RobotPose) -> DetectionUpdate:
        """Map what a message shows, taken at `stamp` [s since 1970]; without views from `pose`."""
        if message.views:
            changes, seen = self._map_views(message.views, stamp)
        else:
            changes, seen = self._map_positions(message.objects, stamp, pose)
        changes = self._relations.update(changes)
        detections = tuple(self._associated(*one) for one in seen)
        return DetectionUpdate(changes, detections, tuple(self._mapper.labels.unknown_labels))

    def existence(self, thing: Detected) -> float:
        """Existence of what stands where a detection was, object or candidate; 0 of nothing."""
        sighting = self._sighting(thing)
        return 0.0 if sighting is None else self._mapper.belief_of(sighting)[1]

    def of(self, categories: Collection[str]) -> tuple[ObjectRecord, ...]:
        """Objects of these categories (IRIs) at present, assertions applied."""
        self._mapper.refresh()
        return tuple(r for r in self._mapper.objects() if r.category in categories)

    def decay(self, iri: str, times: int = 1, recall: float | None = None) -> ObjectChanges:
        """Changes after `times` looks that should have shown the object and did not.

        `recall` is the chance that such a look shows it; the detector's greatest by default.
        Looks that were mapped as views count no more: each picture has, for what it missed.
        """
        if self._has_views:
            return ObjectChanges()
        return self._relations.update(self._mapper.decay(iri, times, recall))

    def _map_views(self, views: Sequence[View], stamp: float) -> tuple[ObjectChanges, list[_Seen]]:
        self._has_views = True
        changes, seen = ObjectChanges(), list[_Seen]()
        for view in views:
            frame = replace(view.frame, stamp=stamp)  # the robot's clock may be another
            changes = changes.followed_by(self._mapper.add(frame, view.detections))
            for one in self._mapper.sightings:
                (_, category), score = max(one.scores.items(), key=lambda item: item[1])
                thing = Detected(self._map.catalogue.label(category), score, *one.p_map.tolist())
                seen.append((thing, category, one))
        return changes, seen

    def _map_positions(
        self, things: Sequence[Detected], stamp: float, pose: RobotPose
    ) -> tuple[ObjectChanges, list[_Seen]]:
        located = [(thing, self._sighting(thing)) for thing in things]
        seen = [(thing, one.category, one) for thing, one in located if one is not None]
        sightings, robot = [one for _, _, one in seen], np.array([pose.x, pose.y])
        return self._mapper.add_sightings(sightings, stamp, robot=robot), list(seen)

    def _sighting(self, thing: Detected) -> Sighting | None:
        """A detection with a position; None where its label has no category."""
        category = self._mapper.labels.category(thing.label)
        if category is None:
            return None
        p_map = np.array([thing.x, thing.y, thing.z])
        return Sighting(category, thing.score, p_map, thing.depth, thing.box, thing.frame)

    def _associated(
        self, thing: Detected, category: str, sighting: Sighting | ThingSighting
    ) -> AssociatedDetection:
        iri, existence = self._mapper.belief_of(sighting)
        record = None if iri is None else self._mapper.get(iri)
        if record is None:
            return AssociatedDetection(thing, category, None, existence)
        return AssociatedDetection(thing, record.category, iri, record.existence)


def decay_missed(
    records: Sequence[ObjectRecord],
    objects: ObjectUpdates,
    adapter: ViewpointAdapter,
    log: SearchLog,
) -> ObjectChanges:
    """Lower the existence of those `records` that later views of the search should have shown."""
    changes = ObjectChanges()
    for record in records:
        times = sum(
            adapter.shows(look, record.p_map)
            for look in log.looks
            if look.stamp > record.last_seen and not look.found
        )
        if times and record.iri not in log.record.found:
            changes = changes.followed_by(objects.decay(record.iri, times, adapter.recall))
    return changes


class RelatedObjects:
    """Objects related to `targets` by NearBy relations, as of the last question."""

    def __init__(self, semantic_map: SemanticMap, targets: Sequence[Target]) -> None:
        self._map = semantic_map
        self._known = self._query(targets)

    def new_among(
        self, records: Sequence[ObjectRecord], targets: Sequence[Target]
    ) -> list[ObjectRecord]:
        """Those of `records` that are related to `targets` and were not at the last question."""
        if not targets:
            return []
        before, self._known = self._known, self._query(targets)
        return [record for record in records if record.iri in self._known - before]

    def _query(self, targets: Sequence[Target]) -> frozenset[str]:
        return frozenset(
            str(row["iri"])
            for target in targets
            for category in target.queried
            for row in self._map.query("goals-nearby", category=category).records()
        )
