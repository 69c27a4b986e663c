"""Detection reporter: makes the report of the fates of detections, and keeps it in the map."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from kg.model.records import Evidence, ObjectRecord
from mapping.detection_files import read_report, write_report
from mapping.detection_report import (
    BELIEVED,
    MAX_OBJECTS,
    MAX_THINGS,
    CategoryFates,
    DetectionReport,
    DoubtedThing,
    Fate,
)
from mapping.objects.detection_fates import DetectionFates, ThingFates
from mapping.objects.object_mapper import ObjectMapper
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

WRITE_INTERVAL: Final = 30.0  # [s] of the report in the map's folder


class DetectionReporter:
    """Reports the fates of a map's detections, those of earlier runs included.

    The report is kept in the map's folder, where there is one. Where the folder cannot be written,
    mapping continues without. The thesis' object mapper has no candidates and no fates.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        objects: ObjectMapper,
        settings: ObjectSettings | None = None,
    ) -> None:
        self._map, self._objects = semantic_map, objects
        self._settings = settings or ObjectSettings()
        self._earlier: tuple[DoubtedThing, ...] = ()  # candidates that other runs left
        self._folder = None if objects.fates is None else semantic_map.store.path
        if self._folder is not None and objects.fates is not None:
            self._resume(self._folder, objects.fates)
        self._written = time.monotonic()

    def report(self) -> DetectionReport:
        """Report of all detections until now."""
        s, tracks = self._settings, self._objects.tracks
        fates = self._objects.fates or DetectionFates()
        fates.settle()
        fates.sweep(tracks)
        things = [*self._doubted_objects(tracks, fates), *self._candidates(tracks, fates)]
        forgotten = [self._forgotten(one) for one in fates.forgotten if one.track.log_odds]
        known = {_view(one) for one in (*things, *forgotten)}
        forgotten += [one for one in self._earlier if _view(one) not in known]
        listed = [*sorted(things, key=_rank), *sorted(forgotten, key=_rank)]
        return DetectionReport(
            frames=fates.frames,
            categories=_categories(fates),
            things=tuple(listed[:MAX_THINGS]),
            doubted=len(things),
            least_score=s.min_score,
            nearest=s.min_depth,
            farthest=s.max_depth,
        )

    def keep(self) -> None:
        """Settle the last frame's fates; write the report every WRITE_INTERVAL."""
        if self._objects.fates is not None:
            self._objects.fates.settle()
        if self._folder is not None and time.monotonic() - self._written > WRITE_INTERVAL:
            self.finish()

    def finish(self) -> None:
        """Write the report into the map's folder."""
        if self._folder is None:
            return
        try:
            write_report(self._folder, self.report())
        except GraphError:
            self._folder = None
        self._written = time.monotonic()

    def _resume(self, folder: Path, fates: DetectionFates) -> None:
        """Add the counts of earlier runs; those of an unreadable report are lost."""
        try:
            report = read_report(folder)
        except GraphError:
            return
        if report is None:
            return
        fates.frames = report.frames
        for name, of in report.categories.items():
            for fate, count in of.fates.items():
                rest = count - sum(of.objects.values()) if fate is Fate.OBJECT else count
                fates.add(name, Fate.FORGOTTEN if fate is Fate.CANDIDATE else fate, max(rest, 0))
            fates.objects[name] = Counter(of.objects)
            fates.merged[name] = of.merged
        self._earlier = tuple(_as_forgotten(one) for one in report.things if not one.iri)

    def _doubted_objects(
        self, tracks: Sequence[Track], fates: DetectionFates
    ) -> list[DoubtedThing]:
        held = {track.iri: track for track in tracks if track.iri is not None}
        return [
            self._object(record, held.get(record.iri), fates)
            for record in self._objects.objects()
            if round(record.existence, 2) < BELIEVED  # as the map has it
        ]

    def _object(
        self, record: ObjectRecord, track: Track | None, fates: DetectionFates
    ) -> DoubtedThing:
        return DoubtedThing(
            category=self._map.catalogue.label(record.category),
            existence=record.existence,
            seen=record.observations,
            iri=record.iri,
            one_side=track is not None and _from_one_side(track, fates),
            p_map=_position(*record.p_map),
            **_best(record.evidence),
        )

    def _candidates(self, tracks: Sequence[Track], fates: DetectionFates) -> list[DoubtedThing]:
        return [
            self._candidate(track, track.existence, _from_one_side(track, fates))
            for track in tracks
            if track.iri is None and track.log_odds
        ]

    def _forgotten(self, thing: ThingFates) -> DoubtedThing:
        track = thing.track
        one_side = thing.one_side and thing.looks >= track.observations
        return _as_forgotten(self._candidate(track, track.peak, one_side))

    def _candidate(self, track: Track, existence: float, one_side: bool) -> DoubtedThing:
        return DoubtedThing(
            category=self._map.catalogue.label(track.category),
            existence=existence,
            seen=track.observations,
            one_side=one_side,
            p_map=_position(*track.position),
            **_best(track.best),
        )


def _from_one_side(track: Track, fates: DetectionFates) -> bool:
    thing = fates.things.get(track.number)
    if thing is None:
        return False
    return thing.one_side and thing.bearing is not None and thing.looks >= track.observations


def _categories(fates: DetectionFates) -> dict[str, CategoryFates]:
    """Counts by category, the most detected first."""
    found = {name: Counter(counts) for name, counts in fates.counts.items()}
    objects = {name: Counter(counts) for name, counts in fates.objects.items()}
    for thing in fates.things.values():
        for name, count in thing.counts.items():
            held = found.setdefault(name, Counter())
            if thing.track.iri is None:
                held[Fate.CANDIDATE] += count
            else:
                objects.setdefault(name, Counter())[thing.track.iri] += count
    for name, counts in objects.items():
        found.setdefault(name, Counter())[Fate.OBJECT] += counts.total()
    made = {
        name: CategoryFates(
            fates={fate: counts[fate] for fate in Fate if counts[fate]},
            objects=dict(objects.get(name, Counter()).most_common(MAX_OBJECTS)),
            merged=fates.merged[name],
        )
        for name, counts in found.items()
    }
    return dict(sorted(made.items(), key=lambda item: (-item[1].detections, item[0])))


def _rank(thing: DoubtedThing) -> tuple[float, str, str]:
    return -thing.existence, thing.category, thing.iri


def _view(thing: DoubtedThing) -> tuple[object, ...]:
    return thing.recording, thing.frame, thing.box


def _as_forgotten(thing: DoubtedThing) -> DoubtedThing:
    return replace(thing, forgotten=True)


def _position(x: float, y: float, z: float) -> tuple[float, float, float]:
    return float(x), float(y), float(z)


def _best(view: Evidence | None) -> dict[str, Any]:
    """Fields of a thing that describe its best view."""
    if view is None:
        return {}
    return {
        "frame": view.frame,
        "recording": view.recording,
        "box": view.box,
        "score": float(view.score),
    }
