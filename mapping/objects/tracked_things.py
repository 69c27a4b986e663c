"""Tracked things: all tracks of a map, stored beside it; changes by other writers are read."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import ObjectRecord
from mapping.frames.sighting import ThingSighting
from mapping.objects.existence import logit
from mapping.objects.object_cache import ObjectCache
from mapping.objects.settings import ObjectSettings
from mapping.objects.track_store import RunState, TrackStore
from mapping.objects.track_updater import TrackUpdater
from mapping.objects.tracks import Track, numbers, same_facts, track_of

_NEARBY = 6.0  # [m] tracks farther from every sighting are skipped


class TrackedThings:
    """The tracks of a map's objects, and of candidates; `objects` is the map's cache.

    A map without a folder here, or open for reading, stores no tracks.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        objects: ObjectCache,
        settings: ObjectSettings,
        updater: TrackUpdater,
    ) -> None:
        self._map, self._objects, self._settings = semantic_map, objects, settings
        self._updater = updater
        self.catalogue = semantic_map.catalogue
        folder = None if semantic_map.store.read_only else semantic_map.store.path
        self._store = None if folder is None else TrackStore(folder)
        self.run = RunState()
        self.tracks: list[Track] = self._loaded()

    def save(self, sequence: int) -> None:
        """Store the tracks beside the map, before its transaction of that number."""
        if self._store is not None:
            self.run.frame, self.run.stamp = self._updater.frame, self._updater.stamp
            self._store.save(self.tracks, self.run, sequence)

    def positions(self) -> NDArray[np.float64]:
        """(n, 3) [m] of all tracks."""
        if not self.tracks:
            return np.zeros((0, 3))
        return np.array([track.p_map for track in self.tracks])

    def near(self, sightings: Sequence[ThingSighting]) -> list[Track]:
        """Tracks that any of the sightings may show, by where they are perceived or asserted."""
        if not sightings or not self.tracks:
            return []
        centre = np.mean([sighting.p_map for sighting in sightings], axis=0)
        reach = _NEARBY + max(float(np.linalg.norm(x.p_map - centre)) for x in sightings)
        offsets = np.linalg.norm(self.positions() - centre, axis=1)
        return [
            track
            for track, offset in zip(self.tracks, offsets, strict=True)
            if offset < reach or self.asserted(track)[0] is not None
        ]

    def asserted(self, track: Track) -> tuple[NDArray[np.float64] | None, str | None]:
        """Position and category of a track as people assert them, where they differ from ours."""
        return self._objects.asserted(track.iri)

    def remove(self, gone: Collection[Track]) -> None:
        """Forget these tracks."""
        ids = {id(track) for track in gone}
        if ids:
            self.tracks = [track for track in self.tracks if id(track) not in ids]

    def forget_candidates(self) -> None:
        """Forget candidates that are improbable, or that were not seen for long."""
        s, least = self._settings, logit(self._settings.removed)
        self.tracks = [
            track
            for track in self.tracks
            if track.iri is not None
            or (
                max(track.log_odds.values()) > least
                and self._updater.frame - track.last_frame < s.forgotten
            )
        ]

    def refresh(self, touched: frozenset[str]) -> None:
        """Begin the tracks of objects anew that other writers changed, among the IRIs `touched`."""
        held = self._objects.perceived
        kept = list[Track]()
        for track in self.tracks:
            if track.iri not in touched:
                kept.append(track)
            elif track.iri in held:
                same = track.written is not None and same_facts(track.written, held[track.iri])
                kept.append(track if same else self._track(held[track.iri]))
        known = {track.iri for track in kept}
        self.tracks = kept + [
            self._track(held[iri])
            for iri in touched
            if iri in held and iri not in known and _is_tracked(held[iri])
        ]

    def forget_categories(self, departed: Sequence[Track]) -> None:
        """Forget categories that left the ontology, and things without evidence of others.

        Tracks of `departed` objects lose the categories, too.
        """
        self.catalogue = self._map.catalogue
        for track in [*self.tracks, *departed]:
            unknown = [c for c in track.evidence if self.catalogue.by_iri(c) is None]
            for category in unknown:
                del track.evidence[category]
            if unknown and track.evidence:
                self._updater.assess(track)
        gone = [track.iri for track in self.tracks if track.iri and not track.evidence]
        self._objects.remove(iri for iri in gone if iri in self._objects.perceived)
        self.tracks = [track for track in self.tracks if track.evidence]

    def _loaded(self) -> list[Track]:
        """The tracks that are stored beside the map, and those of all other objects."""
        stored = list[Track]()
        if self._store is not None:
            stored, self.run = self._store.load(self._map.sequence, self._settings)
            numbers.reserve(track.number for track in stored)
            self._updater.frame, self._updater.stamp = self.run.frame, self.run.stamp
        tracks, held = list[Track](), dict(self._objects.perceived)
        for track in stored:
            if any(self.catalogue.by_iri(category) is None for category in track.evidence):
                continue
            absent = track.absent
            self._updater.assess(track)
            track.absent = absent
            track.conclude()
            if track.iri is not None:
                record = held.get(track.iri)
                if record is None or not same_facts(track.record(), record):
                    continue
                track.written = held.pop(track.iri)
            track.changed = False
            tracks.append(track)
        return tracks + [self._track(record) for record in held.values() if _is_tracked(record)]

    def _track(self, record: ObjectRecord) -> Track:
        return track_of(record, self._settings, self._updater.usual_size)


def _is_tracked(record: ObjectRecord) -> bool:
    """Whether detections decide about an object; `mapping.things` does of those it found."""
    return record.category != v.UNNAMED_THING
