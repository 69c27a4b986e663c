"""Object updates from a search: pictures are mapped like a recording, or positions are.

An object loses existence when a view misses it. A new object related to a target calls for a new
plan.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.history.reports.comparison import PRESENT
from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting, ThingSighting
from mapping.labels.label_resolver import LabelTable
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.object_mapper import ObjectChanges
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import ReferenceSettings
from mapping.relations.relation_mapper import RelationMapper
from planner.execution.protocol import Detected, DetectedFrame, DetectionsMessage, RobotPose
from planner.execution.search_log import SearchLog
from planner.execution.viewpoint_adapter import ViewpointAdapter
from planner.search.goals.targets import Target


@dataclass(frozen=True, slots=True)
class AssociatedDetection:
    """A robot's detection and the object of the map that it was associated with."""

    thing: Detected
    category: str  # IRI: the object's, assertions applied; for a candidate the label's
    iri: str | None  # of the object; None for a candidate, which is not in the map yet
    existence: float  # of the object or candidate, with this detection


@dataclass(frozen=True, slots=True)
class DetectionUpdate:
    """Effect of one message of detections on the map."""

    changes: ObjectChanges  # to be written
    detections: tuple[AssociatedDetection, ...]  # of known labels
    unknown: tuple[str, ...]  # all labels so far without a category of objects

    @property
    def shown(self) -> frozenset[str]:
        """IRIs of the objects that were detected."""
        return frozenset(one.iri for one in self.detections if one.iri is not None)


_Located = tuple[Detected, str, Sighting | ThingSighting]  # with its category's IRI


class ObjectUpdates:
    """Object mapper of a map during a search; it writes nothing.

    Observations name `recording`, which is the search, and the robot's `detector`.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        recording: str = "search",
        detector: str = "",
        labels: LabelTable | None = None,
    ) -> None:
        places = PlaceRegistry(semantic_map, recording=None)
        self._mapper = BayesObjectMapper(
            semantic_map, places=places, recording=recording, model=detector, labels=labels
        )
        self._relations = RelationMapper(semantic_map, self._mapper.cache)
        self._map = semantic_map
        self._has_views = False

    def add(self, message: DetectionsMessage, stamp: float, pose: RobotPose) -> DetectionUpdate:
        """Map the views or positions of a message of `stamp` [s since 1970].

        Positions are as seen from `pose`.
        """
        if message.views:
            changes, located = self._map_views(message.views, stamp)
        else:
            changes, located = self._map_positions(message.objects, stamp, pose)
        changes = self._relations.update(changes)
        detections = tuple(self._associated(*detection) for detection in located)
        return DetectionUpdate(changes, detections, tuple(self._mapper.labels.unknown_labels))

    def existence(self, thing: Detected) -> float:
        """Existence of the object or candidate at a detection's position; 0 without one."""
        sighting = self._sighting(thing)
        return 0.0 if sighting is None else self._mapper.belief_of(sighting)[1]

    def of(self, categories: Collection[str]) -> tuple[ObjectRecord, ...]:
        """Present objects of these categories (IRIs), assertions applied."""
        self._mapper.refresh()
        return tuple(r for r in self._mapper.objects() if r.category in categories)

    def decay(self, iri: str, times: int = 1, recall: float | None = None) -> ObjectChanges:
        """Changes after `times` views that missed the object.

        `recall` is the chance that such a view detects it; by default the detector's greatest.
        Nothing changes once views were mapped as pictures, since each picture lowers the existence
        of the objects that it misses.
        """
        if self._has_views:
            return ObjectChanges()
        return self._relations.update(self._mapper.decay(iri, times, recall))

    def _map_views(
        self, views: Sequence[DetectedFrame], stamp: float
    ) -> tuple[ObjectChanges, list[_Located]]:
        self._has_views = True
        changes, located = ObjectChanges(), list[_Located]()
        for view in views:
            frame = replace(view.frame, stamp=stamp)  # the robot's clock may differ from ours
            changes = changes.followed_by(self._mapper.add(frame, view.detections))
            for sighting in self._mapper.sightings:
                (_, category), score = max(sighting.scores.items(), key=lambda item: item[1])
                label = self._map.catalogue.label(category)
                thing = Detected(label, score, *sighting.p_map.tolist())
                located.append((thing, category, sighting))
        return changes, located

    def _map_positions(
        self, things: Sequence[Detected], stamp: float, pose: RobotPose
    ) -> tuple[ObjectChanges, list[_Located]]:
        pairs = [(thing, self._sighting(thing)) for thing in things]
        located = [(thing, one.category, one) for thing, one in pairs if one is not None]
        sightings, robot = [one for _, _, one in located], np.array([pose.x, pose.y])
        return self._mapper.add_sightings(sightings, stamp, robot=robot), list(located)

    def _sighting(self, thing: Detected) -> Sighting | None:
        """A detection with its category; None where its label has none."""
        category = self._mapper.labels.category(thing.label)
        if category is None:
            return None
        p_map = np.array([thing.x, thing.y, thing.z])
        return Sighting(category, thing.score, p_map, thing.depth, thing.box, thing.frame)

    def _associated(
        self, thing: Detected, category: str, sighting: Sighting | ThingSighting
    ) -> AssociatedDetection:
        iri, existence = self._mapper.belief_of(sighting)
        record = None if iri is None else self._mapper.cache.get(iri)
        if record is None:
            return AssociatedDetection(thing, category, None, existence)
        return AssociatedDetection(thing, record.category, iri, record.existence)


def decay_missed(
    records: Sequence[ObjectRecord],
    objects: ObjectUpdates,
    adapter: ViewpointAdapter,
    log: SearchLog,
) -> ObjectChanges:
    """Lower the existence of the objects `records` that later views of the search missed."""
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
    """Objects related to `targets` by NearBy relations, as of the last query."""

    def __init__(self, semantic_map: SemanticMap, targets: Sequence[Target]) -> None:
        self._map = semantic_map
        self._related = self._query(targets)

    def new_among(
        self, records: Sequence[ObjectRecord], targets: Sequence[Target]
    ) -> list[ObjectRecord]:
        """The objects among `records` that became related to `targets` since the last query."""
        if not targets:
            return []
        before, self._related = self._related, self._query(targets)
        return [record for record in records if record.iri in self._related - before]

    def _query(self, targets: Sequence[Target]) -> frozenset[str]:
        return frozenset(
            str(row["iri"])
            for target in targets
            for category in target.queried
            for row in self._map.query("goals-nearby", category=category).records()
        )


SURE: Final = 0.6  # score from which on a single detection can be certain
MAX_VERIFICATIONS: Final = 3  # views taken to verify one spot
SAME_SPOT: Final = ReferenceSettings().kappa  # [m] between detections of one object
#: existence from which on a detection is verified again after a second view missed it
POSSIBLE: Final = 0.2
ASIDE: Final = 0.6  # [rad] around the object to the next viewpoint, since it may be occluded

Spot = tuple[str, int, int]  # category's IRI, and a square metre of the floor


@dataclass(frozen=True, slots=True)
class TargetDetection:
    """Detection that may be a target."""

    target: Target
    category: str  # IRI
    thing: Detected
    object: str | None  # IRI of the associated object
    certain: bool

    @property
    def p_map(self) -> NDArray[np.float64]:
        """(3,) [m]."""
        return np.array([self.thing.x, self.thing.y, self.thing.z])

    def shows(self, other: TargetDetection) -> bool:
        """Whether both show the same object, or the same category at the same spot."""
        if self.object is not None and self.object == other.object:
            return True
        distance = float(np.linalg.norm(self.p_map - other.p_map))
        return self.category == other.category and distance < SAME_SPOT

    @property
    def spot(self) -> Spot:
        """Category and rough position; IRIs differ when an object is removed and detected again."""
        return self.category, round(self.thing.x), round(self.thing.y)


class DetectionVerifier:
    """Judges detections of targets, and counts the views that verify each spot."""

    def __init__(self) -> None:
        self._earlier: list[tuple[str, NDArray[np.float64]]] = []  # category and position
        self._views: Counter[Spot] = Counter()

    def judge(self, target: Target, detection: AssociatedDetection) -> TargetDetection:
        """Judge a detection: certain if it is likely, and repeated or of a high score."""
        thing, category = detection.thing, detection.category
        p_map = np.array([thing.x, thing.y, thing.z])
        repeated = any(
            category == other and float(np.linalg.norm(p_map - p_other)) < SAME_SPOT
            for other, p_other in self._earlier
        )
        self._earlier.append((category, p_map))
        likely = detection.iri is not None and detection.existence >= PRESENT
        certain = likely and (repeated or thing.score >= SURE)
        return TargetDetection(target, category, thing, detection.iri, certain)

    def open(self, detection: TargetDetection) -> bool:
        """Whether another view may verify the detection."""
        return self._views[detection.spot] < MAX_VERIFICATIONS

    def doubtful(self, detections: Sequence[TargetDetection]) -> list[TargetDetection]:
        """Uncertain detections that another view may verify, one for each spot."""
        return list({d.spot: d for d in detections if not d.certain and self.open(d)}.values())

    def aside(self, detection: TargetDetection) -> float:
        """[rad] around the object to the next viewpoint; the first view is straight."""
        return ASIDE if self._views[detection.spot] else 0.0

    def count_view(self, detection: TargetDetection) -> None:
        """Count a view taken to verify the detection."""
        self._views[detection.spot] += 1
