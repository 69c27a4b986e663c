"""Detection reporter: makes the report of the fates of detections, and keeps it in the map."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Final

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from kg.model.records import Evidence
from mapping.objects.detections.detection_report import (
    BELIEVED,
    MAX_THINGS,
    DetectionFates,
    DetectionReport,
    DoubtedThing,
    Fate,
    read_report,
    write_report,
)
from mapping.objects.object_mapper import ObjectMapper
from mapping.objects.settings import ObjectSettings

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
        self._folder = None if objects.fates is None else semantic_map.store.path
        if self._folder is not None and objects.fates is not None:
            _resume(self._folder, objects.fates)
        self._written = time.monotonic()

    def report(self) -> DetectionReport:
        """Report of all detections until now."""
        s, fates = self._settings, self._objects.fates or DetectionFates()
        fates.settle()
        fates.sweep(self._objects.tracks)
        things = sorted(self._doubted(), key=lambda one: (-one.existence, one.category, one.iri))
        return DetectionReport(
            frames=fates.frames,
            categories=fates.by_category(),
            things=tuple(things[:MAX_THINGS]),
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

    def _doubted(self) -> list[DoubtedThing]:
        label = self._map.catalogue.label
        things = [
            _thing(label(one.category), one.existence, one.observations, one.evidence, one.iri)
            for one in self._objects.objects()
            if round(one.existence, 2) < BELIEVED  # as the map has it
        ]
        return things + [
            _thing(label(track.category), track.existence, track.observations, track.best)
            for track in self._objects.tracks
            if track.iri is None and track.log_odds
        ]


def _resume(folder: Path, fates: DetectionFates) -> None:
    """Add the counts of earlier runs; an unreadable report has none."""
    try:
        report = read_report(folder)
    except GraphError as error:
        _log.warning("%s; the counts of earlier runs are lost", error)
        return
    if report is not None:
        fates.frames = report.frames
        for name, counts in report.categories.items():
            for fate, count in counts.items():
                fates.add(name, Fate.FORGOTTEN if fate is Fate.CANDIDATE else fate, max(count, 0))


def _thing(
    category: str, existence: float, seen: int, view: Evidence | None, iri: str = ""
) -> DoubtedThing:
    """A doubted thing with its best view, in the precision of the report."""
    existence = round(existence, 4)
    if view is None:
        return DoubtedThing(category, existence, seen, iri)
    left, top, right, bottom = (round(float(side), 1) for side in view.box)
    return DoubtedThing(
        category,
        existence,
        seen,
        iri,
        frame=view.frame,
        recording=view.recording,
        box=(left, top, right, bottom),
        score=round(float(view.score), 4),
    )
