"""Detection reporter: makes the report of the fates of detections, and keeps it in the map."""

from __future__ import annotations

import logging
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from kg.model.records import Evidence
from mapping.objects.detections.detection_report import (
    BELIEVED,
    MAX_OBJECTS,
    MAX_THINGS,
    CategoryFates,
    DetectionFates,
    DetectionReport,
    DoubtedThing,
    Fate,
    ThingFates,
    read_report,
    write_report,
)
from mapping.objects.object_mapper import ObjectMapper
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

WRITE_INTERVAL: Final = 30.0  # [s] between two reports in the map's folder


_log = logging.getLogger(__name__)


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
        self._earlier: tuple[DoubtedThing, ...] = ()  # candidates of earlier runs
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
        forgotten = [
            replace(self._candidate(thing.track, thing.track.peak, thing), forgotten=True)
            for thing in fates.forgotten
            if thing.track.log_odds
        ]
        views = {_view(thing) for thing in (*things, *forgotten)}
        forgotten += [thing for thing in self._earlier if _view(thing) not in views]
        return DetectionReport(
            frames=fates.frames,
            categories=_categories(fates),
            things=(*sorted(things, key=_rank), *sorted(forgotten, key=_rank))[:MAX_THINGS],
            doubted=len(things),
            least_score=s.min_score,
            nearest=s.min_depth,
            farthest=s.max_depth,
        )

    def keep(self) -> None:
        """Settle the last frame's fates; write the report every WRITE_INTERVAL."""
        if self._objects.fates is not None:
            self._objects.fates.settle()
        if time.monotonic() - self._written > WRITE_INTERVAL:
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
        """Add the counts of earlier runs; an unreadable report has none."""
        try:
            report = read_report(folder)
        except GraphError as error:
            _log.warning("%s; the counts of earlier runs are lost", error)
            return
        if report is None:
            return
        fates.frames = report.frames
        for name, category in report.categories.items():
            for fate, count in category.fates.items():
                if fate is Fate.OBJECT:
                    count -= sum(category.objects.values())
                fates.add(name, Fate.FORGOTTEN if fate is Fate.CANDIDATE else fate, max(count, 0))
            fates.objects[name] = Counter(category.objects)
            fates.merged[name] = category.merged
        candidates = (thing for thing in report.things if not thing.iri)
        self._earlier = tuple(replace(thing, forgotten=True) for thing in candidates)

    def _doubted_objects(
        self, tracks: Sequence[Track], fates: DetectionFates
    ) -> list[DoubtedThing]:
        by_iri = {track.iri: fates.things.get(track.number) for track in tracks}
        return [
            _doubted(
                self._map.catalogue.label(record.category),
                record.existence,
                record.observations,
                record.p_map,
                record.evidence,
                by_iri.get(record.iri),
                record.iri,
            )
            for record in self._objects.objects()
            if round(record.existence, 2) < BELIEVED  # as the map has it
        ]

    def _candidates(self, tracks: Sequence[Track], fates: DetectionFates) -> list[DoubtedThing]:
        return [
            self._candidate(track, track.existence, fates.things.get(track.number))
            for track in tracks
            if track.iri is None and track.log_odds
        ]

    def _candidate(self, track: Track, existence: float, seen: ThingFates | None) -> DoubtedThing:
        label = self._map.catalogue.label(track.category)
        p_map, times = track.outline.centre, track.observations
        return _doubted(label, existence, times, p_map, track.best, seen)


def _doubted(
    category: str,
    existence: float,
    seen: int,
    p_map: NDArray[np.float64],
    view: Evidence | None,
    fates: ThingFates | None,
    iri: str = "",
) -> DoubtedThing:
    """A doubted thing with its best view, in the precision of the report."""
    x, y, z = (round(float(side), 3) for side in p_map)
    one_side = fates is not None and fates.one_side
    thing = DoubtedThing(category, round(existence, 4), seen, iri, one_side, p_map=(x, y, z))
    if view is None:
        return thing
    left, top, right, bottom = (round(float(side), 1) for side in view.box)
    return replace(
        thing,
        frame=view.frame,
        recording=view.recording,
        box=(left, top, right, bottom),
        score=round(float(view.score), 4),
    )


def _categories(fates: DetectionFates) -> dict[str, CategoryFates]:
    """Counts by category, the most detected first."""
    counts = defaultdict(Counter[Fate], {n: Counter(c) for n, c in fates.counts.items()})
    objects = defaultdict(Counter[str], {n: Counter(c) for n, c in fates.objects.items()})
    for thing in fates.things.values():
        for name, count in thing.counts.items():
            if thing.track.iri is None:
                counts[name][Fate.CANDIDATE] += count
            else:
                objects[name][thing.track.iri] += count
    for name, of_objects in objects.items():
        counts[name][Fate.OBJECT] += of_objects.total()
    made = {
        name: CategoryFates(
            fates={fate: of_name[fate] for fate in Fate if of_name[fate]},
            objects=dict(objects[name].most_common(MAX_OBJECTS)),
            merged=fates.merged[name],
        )
        for name, of_name in counts.items()
    }
    return dict(sorted(made.items(), key=lambda item: (-item[1].detections, item[0])))


def _rank(thing: DoubtedThing) -> tuple[float, str, str]:
    return -thing.existence, thing.category, thing.iri


def _view(thing: DoubtedThing) -> tuple[object, ...]:
    return thing.recording, thing.frame, thing.box
