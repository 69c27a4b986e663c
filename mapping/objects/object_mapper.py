"""Object mappers: the base of both, and the thesis' own mapper (section 3.3.1)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import DepartedRecord, Evidence, ObjectRecord
from mapping.frames.projection import to_map
from mapping.frames.sighting import Sighting
from mapping.labels.label_resolver import LabelResolver, LabelTable
from mapping.objects.detections.detection_report import DetectionFates
from mapping.objects.object_cache import ObjectCache
from mapping.objects.tracks import Track
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.depth_histogram import localise
from mapping.reference.object_update import (
    Association,
    associate,
    decayed,
    existence,
    missed,
    most_confident,
    new_object,
    updated_object,
)
from mapping.reference.settings import ReferenceSettings
from perception.frames import Detections, Frame


@dataclass(frozen=True, slots=True)
class ObjectChanges:
    """Changes of the map's objects that one frame, or one set of sightings, leads to."""

    updated: tuple[ObjectRecord, ...] = ()  # whole new records, as perception believes them
    removed: tuple[str, ...] = ()  # IRIs
    departed: tuple[DepartedRecord, ...] = ()  # records of removed objects that left
    joined: tuple[tuple[str, str], ...] = ()  # IRI of a removed object, and of that which it is

    def followed_by(self, later: ObjectChanges) -> ObjectChanges:
        """Both changes as one, with the last state of each object."""
        latest = {record.iri: record for record in (*self.updated, *later.updated)}
        removed = {*self.removed, *later.removed} - {record.iri for record in later.updated}
        left = {record.iri: record for record in (*self.departed, *later.departed)}
        return ObjectChanges(
            tuple(record for iri, record in latest.items() if iri not in removed),
            tuple(sorted(removed)),
            tuple(record for iri, record in left.items() if iri in removed),
            (*self.joined, *later.joined),
        )


class ObjectMapper(ABC):
    """Turns detections into changes of the map's objects; writes nothing to the map itself.

    Its state is a cache of the map, read again where others wrote since. `labels` resolves the
    detector's labels.
    """

    labels: LabelResolver
    fates: DetectionFates | None = None  # of all detections; None: the mapper does not count them
    unplaced = 0  # detections so far without usable depth

    def __init__(self, semantic_map: SemanticMap, places: PlaceRegistry | None) -> None:
        self._map, self._places = semantic_map, places
        self.cache = ObjectCache(semantic_map)  # objects as perceived, and assertions about them
        self._revision = -1  # of the places' rectangles, when objects were last put into places
        self._touched = set[str]()  # IRIs of things that others changed since then

    @property
    def tracks(self) -> Sequence[Track]:
        """Objects and candidates that the mapper follows, if any."""
        return ()

    @property
    def looked_from(self) -> dict[str, NDArray[np.float64]]:
        """Pose (4, 4) of the last frame that each detector, by name, ran on, where it is kept."""
        return {}

    def objects(self) -> tuple[ObjectRecord, ...]:
        """All objects, with assertions applied."""
        return self.cache.objects()

    @abstractmethod
    def add(self, frame: Frame, detections: Detections) -> ObjectChanges:
        """Process one frame: objects seen, new ones, and those that the frame should show."""

    @abstractmethod
    def add_sightings(
        self,
        sightings: Sequence[Sighting],
        stamp: float,
        robot: NDArray[np.float64] | None = None,
    ) -> ObjectChanges:
        """Process detections that have positions already.

        As `add`, but without negative evidence, as nothing is known of what the sensor could see.

        Args:
            sightings: the detections. One call is one look: a thing counts once.
            stamp: when they were taken [s since 1970].
            robot: (2,) [m] position they were taken from; the Bayes mapper gives less weight to
                things seen again from there.
        """

    def finish(self) -> ObjectChanges:
        """Changes that are left at the end of a recording, as boxes of objects."""
        return ObjectChanges()

    def save(self, sequence: int) -> None:  # noqa: B027 - nothing to store by default
        """Store the mapper's own state beside the map, before its transaction of that number."""

    def undo(self, changes: ObjectChanges) -> None:
        """Discard changes that could not be written; their objects are read again."""
        self.cache.invalidate((*(record.iri for record in changes.updated), *changes.removed))
        self._revision = -1

    def refresh(self) -> None:
        """Read changes of other writers since the last call; cheap where there are none."""
        if self._places is not None:
            self._places.refresh()
        self._touched |= self.cache.refresh()

    def _place(self, record: ObjectRecord) -> str | None:
        """IRI of the place that contains the object's believed position."""
        if self._places is None:
            return record.place
        return self._places.at(self.cache.believed(record).p_map)

    def _moved(self) -> dict[str, ObjectRecord]:
        """Objects that are in another place since they, or the places' rectangles, changed."""
        if self._places is None:
            return {}
        held: dict[str, ObjectRecord] = self.cache.perceived
        if self._places.revision == self._revision:
            held = {iri: held[iri] for iri in self._touched if iri in held}
        self._revision = self._places.revision
        self._touched.clear()
        placed = ((record, self._place(record)) for record in held.values())
        return {
            record.iri: replace(record, place=place)
            for record, place in placed
            if place != record.place
        }


class ReferenceObjectMapper(ObjectMapper):
    """The thesis' object mapper: association, confidence and negative evidence, frame by frame.

    It holds what perception believes; assertions decide which object a detection belongs to.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: ReferenceSettings,
        places: PlaceRegistry | None = None,
        *,
        recording: str = "",
        model: str = "",
        labels: LabelTable | None = None,
    ) -> None:
        super().__init__(semantic_map, places)
        self._settings = settings
        self._recording, self._model = recording, model
        self.labels = LabelResolver(
            semantic_map, "object", table=labels, unknown=settings.unknown_labels, model=model
        )

    def add(self, frame: Frame, detections: Detections) -> ObjectChanges:
        """Process one frame: reinforce seen objects, register new ones, decay missed ones."""
        self.refresh()
        found = self._associated(self._sightings(frame, detections))
        missing = self._missing(frame, found.matched)
        changes = self._changes(found, missing, frame.stamp)
        moved = self._moved()
        self.cache.update(moved)
        updated = {record.iri: record for record in changes.updated} | moved
        return replace(changes, updated=tuple(updated.values()))

    def add_sightings(
        self,
        sightings: Sequence[Sighting],
        stamp: float,
        robot: NDArray[np.float64] | None = None,
    ) -> ObjectChanges:
        """Process detections that have positions already; `robot` does not count here."""
        self.refresh()
        return self._changes(self._associated(sightings), (), stamp)

    def _sightings(self, frame: Frame, detections: Detections) -> list[Sighting]:
        """Localised detections of known labels, in their order."""
        s, sightings = self._settings, list[Sighting]()
        self.labels.learn(
            label
            for label, score in zip(detections.label, detections.score, strict=True)
            if score >= s.min_score
        )
        sources = detections.source or ("",) * len(detections)
        reference = detections.detectors[:1] or ("",)  # the thesis knows one detector
        masks = detections.mask or (None,) * len(detections)
        for box, score, label, source, mask in zip(
            detections.xyxy, detections.score, detections.label, sources, masks, strict=True
        ):
            category = self.labels.category(label) if source in reference else None
            if category is None or score < s.min_score:
                continue
            p_cam = localise(frame, box, s, mask)
            if p_cam is None:
                self.unplaced += 1
                continue
            x1, y1, x2, y2 = (float(side) for side in box)
            p_map, depth = to_map(frame.T_map_cam, p_cam), float(p_cam[2])
            pixels = (x1, y1, x2, y2)
            sightings.append(Sighting(category, float(score), p_map, depth, pixels, frame.id))
        return sightings

    def _changes(
        self, found: Association, missing: Sequence[ObjectRecord], stamp: float
    ) -> ObjectChanges:
        s = self._settings
        objects = self.cache.perceived
        seen = [self._seen(objects[iri], x, stamp) for iri, x in found.matched.items()]
        in_range = [
            x for x in found.new if x.depth is None or s.min_depth <= x.depth <= s.max_depth
        ]
        new = [self._new(x, stamp) for x in most_confident(in_range, s.kappa)]
        fallen = [self._decayed(record) for record in missing]
        removed = self._without_confidence(fallen)
        self.cache.remove(removed)
        changed = {r.iri: r for r in (*seen, *new, *fallen) if r.iri not in removed}
        self.cache.update(changed)
        return ObjectChanges(tuple(changed.values()), removed)

    def _associated(self, sightings: Sequence[Sighting]) -> Association:
        return associate(sightings, tuple(self.cache.candidates()), self._settings.kappa)

    def _missing(self, frame: Frame, matched: Collection[str]) -> list[ObjectRecord]:
        """Objects that this frame should have shown (eq. 3.2, 3.3) and did not."""
        return [
            record
            for record in self.cache.perceived.values()
            if record.iri not in matched
            and missed(frame, self.cache.believed(record).p_map, self._settings)
        ]

    def _without_confidence(self, decayed: Sequence[ObjectRecord]) -> tuple[str, ...]:
        """IRIs of objects to be removed; those whose existence is asserted stay."""
        kept = self.cache.asserted_present
        return tuple(r.iri for r in decayed if r.confidence <= 0 and not kept(r.iri))

    def _seen(self, record: ObjectRecord, sighting: Sighting, stamp: float) -> ObjectRecord:
        evidence = record.evidence
        if evidence is None or sighting.score > evidence.score:
            evidence = self._evidence(sighting, stamp) or evidence
        after = updated_object(record, sighting, stamp, self._settings)
        return replace(after, place=self._place(after), evidence=evidence)

    def _new(self, sighting: Sighting, stamp: float) -> ObjectRecord:
        return replace(
            new_object(self._map.new_object_iri(), sighting, stamp, self._settings),
            place=self._places.at(sighting.p_map) if self._places else None,
            evidence=self._evidence(sighting, stamp),
        )

    def _decayed(self, record: ObjectRecord) -> ObjectRecord:
        confidence = decayed(record.confidence, self._settings.xi)
        if self.cache.asserted_present(record.iri):
            confidence = max(confidence, 0.0)
        return replace(
            record,
            confidence=confidence,
            existence=existence(max(confidence, 0.0), self._settings.nu),
        )

    def _evidence(self, sighting: Sighting, stamp: float) -> Evidence | None:
        if sighting.box is None:
            return None
        return Evidence(
            frame=sighting.frame,
            recording=self._recording,
            stamp=stamp,
            box=sighting.box,
            score=sighting.score,
            model=self._model,
        )
