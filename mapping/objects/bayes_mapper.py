"""Bayes mapper of objects: multi-view existence, one identity for each thing, extents.

Each frame's detections are grouped by thing and localised, associated with tracks, and counted as
evidence: a hit or a miss of each category of a track. A track becomes an object of the map once it
is probable enough, and leaves it when it is improbable.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting, ThingSighting
from mapping.labels.label_resolver import LabelResolver, LabelTable
from mapping.objects.absence import RECALL
from mapping.objects.association import associate
from mapping.objects.detections.detection_report import DetectionFates, Fate
from mapping.objects.existence import in_front
from mapping.objects.extents.extent_grower import ExtentGrower
from mapping.objects.extents.surface_growth import Voxels
from mapping.objects.object_mapper import ObjectChanges, ObjectMapper
from mapping.objects.reidentification.identity import IdentityResolver, duplicates
from mapping.objects.reidentification.moves import LookRatio
from mapping.objects.settings import ObjectSettings
from mapping.objects.sightings import SightingExtractor
from mapping.objects.track_store import TrackedThings
from mapping.objects.track_updater import TrackUpdater
from mapping.objects.tracks import CELL, Track, Viewpoint, count_together, viewpoint
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import UnknownLabels
from perception.frames import Detections, Frame


class BayesObjectMapper(ObjectMapper):
    """Bayes mapper of objects.

    Where others change an object, its track starts anew from its record. With `voxels` of the
    surface, objects get boxes that are grown from it; else those of their latest sightings. With
    `looks`, pictures count for what moved where.
    """

    fates: DetectionFates

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: ObjectSettings | None = None,
        places: PlaceRegistry | None = None,
        *,
        recording: str = "",
        model: str = "",
        labels: LabelTable | None = None,
        unknown_labels: UnknownLabels = "ignore",
        voxels: Voxels | None = None,
        looks: LookRatio | None = None,
    ) -> None:
        super().__init__(semantic_map, places)
        self._grower = None if voxels is None else ExtentGrower(voxels)
        self._settings = settings or ObjectSettings()
        self.labels = LabelResolver(
            semantic_map, "object", table=labels, unknown=unknown_labels, model=model
        )
        self._updater = TrackUpdater(semantic_map, self._settings, recording=recording, model=model)
        self._extractor = SightingExtractor(self.labels, self._updater.usual_size, self._settings)
        self.fates = self._extractor.fates
        self._held = TrackedThings(semantic_map, self.cache, self._settings, self._updater)
        self._new: set[str | None] = set()  # IRIs that the last frame gave
        self.sightings: list[ThingSighting] = []  # of the last frame, strongest first
        self._identity = IdentityResolver(
            semantic_map, self.cache, self._settings, self._updater.usual_size, looks
        )

    @property
    def tracks(self) -> Sequence[Track]:
        """Objects and candidates."""
        return self._held.tracks

    def belief_of(self, sighting: Sighting | ThingSighting) -> tuple[str | None, float]:
        """IRI (None: a candidate) and existence of the thing that `sighting` shows now."""
        if isinstance(sighting, Sighting):
            sighting = self._extractor.of_position(sighting)
        known = self._associated((sighting,))
        return (known[0][1].iri, known[0][1].certainty) if known else (None, 0.0)

    @property
    def looked_from(self) -> dict[str, NDArray[np.float64]]:
        """Pose (4, 4) of the last frame that each detector, by name, looked at."""
        return {name: np.array(pose) for name, pose in self._held.run.looked_from.items()}

    def save(self, sequence: int) -> None:
        """Store the tracks beside the map, before its transaction of that number."""
        self._held.save(sequence)

    def add(self, frame: Frame, detections: Detections) -> ObjectChanges:
        """Process one frame: hits, misses, new candidates, merges."""
        self.refresh()
        looked_from = self._held.run.looked_from
        looked_from.update(dict.fromkeys(detections.detectors, frame.T_map_cam.tolist()))
        view = viewpoint(frame.T_map_cam)
        self._updater.begin(frame.stamp, len(detections.detectors) == 1 < len(looked_from), view)
        self.fates.begin(self._held.tracks)
        self.sightings = sightings = self._extractor.sightings(frame, detections)
        self.unplaced = self._extractor.unplaced
        known = self._associated(sightings)
        for sighting, track in known:
            self._updater.see(track, sighting, frame, view)
            self.fates.seen(track, sighting.categories)
        count_together([track for _, track in known])
        seen = [track for _, track in known]
        missed = self._updater.miss(self._in_front(frame, seen), frame, view)
        matched = {id(sighting) for sighting, _ in known}
        born = [
            self._born(sighting, frame, view)
            for sighting in sightings
            if id(sighting) not in matched and self._may_be_new(sighting)
        ]
        self._held.tracks += born
        merged = self._merge([*seen, *born])
        grown = None if self._grower is None else self._grower.grow_one(seen)
        if grown is not None:
            self._updater.reassess(grown)
        return self._changes([*seen, *born], missed, merged)

    def add_sightings(
        self,
        sightings: Sequence[Sighting],
        stamp: float,
        robot: NDArray[np.float64] | None = None,
    ) -> ObjectChanges:
        """Process detections that have positions already, taken at `stamp` [s since 1970]."""
        self.refresh()
        self._updater.begin(stamp)
        self.fates.begin(self._held.tracks)
        touched, born = dict[int, Track](), list[Track]()
        weights, counted = dict[int, float](), set[tuple[int, str]]()
        view = () if robot is None else tuple(np.floor(robot / CELL).astype(int).tolist())
        for one in sightings:
            # one by one: a message may hold the same thing several times, from several pictures
            sighting = self._extractor.of_position(one)
            known = self._associated((sighting,))
            track = known[0][1] if known else self._updater.new_track(sighting, stamp)
            if id(track) not in touched:
                touched[id(track)] = track
                weights[id(track)] = track.look(view)
            weight = weights[id(track)]
            self._updater.locate(track, sighting, weight, stamp)
            if (id(track), one.category) not in counted:  # a call is one look
                counted.add((id(track), one.category))
                track.hit(sighting.best, weight, 1.0)
            self._updater.finish(track, sighting, stamp, one.frame)
            self.fates.seen(track, sighting.categories)
            if not known:
                self._held.tracks.append(track)
                born.append(track)
        seen = list(touched.values())
        merged = self._merge(seen)
        for track in born:
            track.assume_extent()
        return self._changes(seen, [], merged)

    def decay(self, iri: str, times: int = 1, recall: float | None = None) -> ObjectChanges:
        """Count `times` misses of the object.

        `recall` is the probability of each detection; by default that of a thing that fills the
        image.
        """
        self.refresh()
        self._updater.begin()
        track = next((track for track in self._held.tracks if track.iri == iri), None)
        if track is None or times < 1:
            return ObjectChanges()
        chance = RECALL if recall is None else recall
        track.looks += times * chance
        for _ in range(times):
            track.absence.miss(1.0, chance)
        self._updater.assess(track)
        return self._changes([], [track], ())

    def finish(self) -> ObjectChanges:
        """Objects that change once all views count: other boxes, or less certain than early on."""
        self.refresh()
        tracks = [] if self._grower is None else self._grower.grow_rest(self._held.tracks)
        tracks += [track for track in self._held.tracks if track.early > self._updater.early]
        for track in tracks:
            self._updater.reassess(track)
        grown = {track.iri: self._record(track) for track in tracks if track.iri is not None}
        self.cache.update(grown)
        return ObjectChanges(tuple(grown.values()))

    def undo(self, changes: ObjectChanges) -> None:
        """Discard changes that could not be written; their objects are read again."""
        super().undo(changes)
        self.fates.undo()
        for track in self._held.tracks:
            if track.iri in self._new:
                track.iri = track.written = None  # a candidate again
            if track.iri is None and track.last_frame == self._updater.frame:
                track.observations -= 1
        self._held.tracks = [
            t for t in self._held.tracks if t.iri is not None or t.observations > 0
        ]
        self._identity.departures.undo()

    def refresh(self) -> None:
        """Read changes of other writers since the last call; cheap where there are none."""
        if self._places is not None:
            self._places.refresh()
        if self._map.catalogue is not self._held.catalogue:
            self._held.forget_categories(self._identity.departures.tracks)
            self._identity.departures.forget_unknown()
        touched = self.cache.refresh()
        self._touched |= touched
        if touched:
            self._identity.refresh(touched)
            self._held.refresh(touched)

    # one frame

    def _associated(self, sightings: Sequence[ThingSighting]) -> list[tuple[ThingSighting, Track]]:
        near = self._held.near(sightings)
        for track in near:
            track.stale = self._updater.stamp - track.last_seen > self._settings.stale
        found = associate(sightings, near, self._held.asserted, self._settings)
        return [(sightings[row], near[column]) for row, column in found.items()]

    def _in_front(self, frame: Frame, seen: Collection[Track]) -> Iterator[Track]:
        """Tracks before the camera that are not among those `seen`, nor asserted elsewhere."""
        shown = {id(track) for track in seen}
        for index in in_front(frame, self._held.positions(), self._settings):
            track = self._held.tracks[index]
            if id(track) not in shown and self._held.asserted(track)[0] is None:
                yield track

    def _may_be_new(self, sighting: ThingSighting) -> bool:
        """Whether an unassociated sighting makes a candidate.

        A box that the border cuts is likely a part of an object of its category nearby.
        """
        s = self._settings
        if not sighting.cut or not self._held.tracks:
            return True
        offsets = np.linalg.norm(self._held.positions() - sighting.p_map, axis=1)
        size = min(sighting.size, s.largest)
        part = any(
            offsets[index] < 0.4 + 0.5 * max(size, min(self._held.tracks[index].size, s.largest))
            and sighting.categories & self._held.tracks[index].plausible
            for index in np.nonzero(offsets < 2.0)[0]
        )
        self.fates.unused(Fate.CUT, sighting.categories if part else ())
        return not part

    def _born(self, sighting: ThingSighting, frame: Frame, view: Viewpoint) -> Track:
        track = self._updater.new_track(sighting, frame.stamp)
        self._updater.see(track, sighting, frame, view)
        self.fates.seen(track, sighting.categories)
        return track

    def _merge(self, touched: Sequence[Track]) -> list[tuple[Track, Track]]:
        """Merge tracks that are one thing; returns pairs of those kept and absorbed.

        An object with assertions is never absorbed.
        """
        found = [
            (kept, absorbed)
            for kept, absorbed in duplicates(
                touched, self._held.tracks, self._updater.usual_size, self._settings
            )
            if not self.cache.has_assertions(absorbed.iri)
        ]
        for kept, absorbed in found:
            kept.merge(absorbed)
            self.fates.merge(kept, absorbed)
            self._updater.assess(kept)
        self._held.remove([absorbed for _, absorbed in found])
        return found

    # changes of the map

    def _changes(
        self,
        seen: Sequence[Track],
        missed: Sequence[Track],
        merged: Sequence[tuple[Track, Track]],
    ) -> ObjectChanges:
        absorbed = [track for _, track in merged]
        gone = {id(track) for track in absorbed}
        every = {id(track): track for track in (*seen, *missed, *(kept for kept, _ in merged))}
        touched = [track for key, track in every.items() if key not in gone]
        confirmed = self._settings.confirmed
        new = [track for track in touched if track.iri is None and track.existence >= confirmed]
        lost = [track for track in touched if track.iri is not None and self._improbable(track)]
        removed = {track.iri for track in (*lost, *absorbed) if track.iri is not None}
        updater = self._updater
        also, old = self._identity.resolve(
            self._held.tracks, new, touched, lost, removed, updater.departed, updater.stamp
        )
        touched += also
        self._held.remove(old)
        for track in new:
            track.iri = track.iri or self._map.new_object_iri()
        self._new = {track.iri for track in seen if track.written is None} - {None}
        self._drop(lost)
        self.cache.remove(iri for iri in removed if iri in self.cache.perceived)
        dropped = {id(track) for track in lost}
        written = {
            track.iri: self._record(track)
            for track in touched
            if track.iri is not None and id(track) not in dropped
        }
        written |= self._put_into_places(written)
        self.cache.update(written)
        departed, forgotten = self._identity.departures.changes(updater.stamp)
        removed |= forgotten
        joined = [(gone.iri, kept.iri) for kept, gone in merged if gone.iri and kept.iri]
        return ObjectChanges(
            tuple(written.values()),
            tuple(sorted(removed)),
            departed,
            (*joined, *self._identity.departures.joined),
        )

    def _improbable(self, track: Track) -> bool:
        """Whether an object leaves the map; misses alone do not prove that it is gone."""
        if self.cache.asserted_present(track.iri):
            return False
        s = self._settings
        if len(track.clear_views) >= s.clear_views or track.presence < s.removed:
            return True
        return bool(track.clear_views) and track.existence < s.removed

    def _drop(self, lost: Sequence[Track]) -> None:
        """Forget objects that left the map, and candidates that nothing speaks for any more."""
        self._held.remove(lost)
        self._held.forget_candidates()

    def _record(self, track: Track) -> ObjectRecord:
        record = track.record()
        if self._places is not None:
            track.place = self._place(record)
            if track.place != record.place:
                record = replace(record, place=track.place)
        track.written, track.labels = record, dict(record.labels)
        return record

    def _put_into_places(self, written: Mapping[str, ObjectRecord]) -> dict[str, ObjectRecord]:
        """Objects beside those `written` that are in another place now."""
        moved = {iri: record for iri, record in self._moved().items() if iri not in written}
        for track in self._held.tracks:
            if track.iri in moved:
                track.written = moved[track.iri]
                track.place = track.written.place
        return moved
