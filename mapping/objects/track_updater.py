"""Track updater: counts the hits and misses of each frame as evidence for tracks."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import Evidence
from kg.model.usual_sizes import UsualSize, usual_sizes
from mapping.frames.sighting import ThingSighting
from mapping.objects.absence import recall
from mapping.objects.existence import MANY, VolumeView, early, ray_test, visibility
from mapping.objects.extents.box_fit import view_row
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track, Viewpoint
from mapping.persistence import departed, listed_half_life
from perception.frames import Frame


class TrackUpdater:
    """Updates tracks with the views of one frame after another.

    `recording` and `model`, the detector, are kept with observations; detections may name another
    detector.
    """

    def __init__(
        self, semantic_map: SemanticMap, settings: ObjectSettings, *, recording: str, model: str
    ) -> None:
        self._map, self._settings = semantic_map, settings
        self._recording, self._model = recording, model
        self.frame = 0  # number of the present one
        self.stamp = 0.0  # [s] of the present one
        self.viewpoints = set[Viewpoint]()  # that frames came from, up to MANY
        self.early = math.inf  # log-odds that things gain by few of these, from the first frame on
        self._counts = 1.0  # share that a miss in it counts

    def begin(
        self, stamp: float | None = None, partial: bool = False, view: Viewpoint | None = None
    ) -> None:
        """Begin the next frame, at `stamp` [s] or the last; `partial`: one network of two looks."""
        self.frame += 1
        if view is not None and len(self.viewpoints) < MANY:
            self.viewpoints.add(view)
        self.early = early(len(self.viewpoints))
        self._counts = self._settings.one_of_two if partial else 1.0
        self.stamp = self.stamp if stamp is None else stamp

    def see(self, track: Track, sighting: ThingSighting, frame: Frame, view: Viewpoint) -> None:
        """Count a sighting as a hit of the track."""
        weight = track.look(view)
        track.absence.hit(weight)
        track.clear_views.clear()
        self.locate(track, sighting, weight, frame.stamp)
        if (row := view_row(frame, sighting)) is not None:
            track.show(row)
        visible = 0.0
        if not sighting.cut:
            side = self._share(track.size, sighting.depth or 1.0, frame)
            visible = self._counts * visibility(side)
        track.hit(sighting.best, weight, visible)
        self.finish(track, sighting, frame.stamp, frame.id)

    def miss(self, tracks: Iterable[Track], frame: Frame, view: Viewpoint) -> list[Track]:
        """Count a miss of each of `tracks` that the frame should show; returns these tracks."""
        s, camera = self._settings, frame.T_map_cam[:3, 3]
        missed = list[Track]()
        for track in tracks:
            shown = ray_test(frame, track.p_map, min(track.size, s.largest), s)
            if shown is VolumeView.NOTHING:
                continue
            weight = track.look(view)
            if shown is VolumeView.EMPTY:
                track.clear_views.add(view)
                track.absence.empty(weight, s.empty_ratio)
            share = self._share(track.size, float(np.linalg.norm(track.p_map - camera)), frame)
            track.absence.miss(weight, recall(share))
            track.looks += weight * self._counts * visibility(share)
            self.assess(track)
            missed.append(track)
        return missed

    def new_track(self, sighting: ThingSighting, stamp: float) -> Track:
        """A candidate at the position of `sighting`, without evidence so far; `stamp` [s]."""
        return Track(
            p_map=sighting.p_map.copy(),
            size=sighting.size,
            settings=self._settings,
            early=self.early,
            first_seen=stamp,
            last_seen=stamp,
        )

    def locate(self, track: Track, sighting: ThingSighting, novelty: float, stamp: float) -> None:
        """Update position, extent and times with a sighting at `stamp` [s]."""
        track.locate(sighting, novelty)
        track.observations += 1
        track.last_seen = max(track.last_seen, stamp)
        track.last_frame = self.frame

    def finish(self, track: Track, sighting: ThingSighting, stamp: float, frame: str) -> None:
        """Assess the track, and keep the sighting if it is the best observation so far."""
        self.assess(track)
        shown = {d: score for (d, c), score in sighting.scores.items() if c == track.name}
        if sighting.box is None or not shown:
            return
        detector = max(shown, key=lambda d: shown[d])
        if track.best is None or shown[detector] > track.best.score:
            track.best = Evidence(
                frame=frame,
                recording=self._recording,
                stamp=stamp,
                box=sighting.box,
                score=shown[detector],
                model=detector or self._model,
            )

    def assess(self, track: Track) -> None:
        """Compute existence and absence anew, from the evidence, the size and the time."""
        track.early = min(track.early, self.early)
        track.assess(self.usual_size, self.departed(track, self.stamp - track.last_seen))

    def reassess(self, track: Track) -> None:
        """Compute its names and existence anew, as with another box; its absence stays."""
        absent = track.absent
        self.assess(track)
        track.absent = absent
        track.conclude()

    def departed(self, track: Track, age: float) -> float:
        """Prior probability that a thing left within `age` [s] after it was seen."""
        likely = track.category if track.category in track.evidence else next(iter(track.evidence))
        return departed(listed_half_life(self._map.catalogue.label(likely)), age)

    def usual_size(self, category: str) -> UsualSize | None:
        """Usual size of a category, by IRI; None where it has none."""
        return usual_sizes().get(self._map.catalogue.label(category))

    def _share(self, size: float, depth: float, frame: Frame) -> float:
        """Side of a thing of `size` [m] at `depth` [m], as a share of the image's side."""
        height, width = frame.depth.shape
        seen = 0.8 * min(size, self._settings.largest) * frame.K[0, 0] / max(depth, 0.3)
        return float(seen / np.sqrt(height * width))
