"""A recording becomes a map: read, detect, look at the scene, map, one transaction a frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

from kg.errors import ConflictError, RecordingError
from kg.records import MapUpdate, RecordingRecord, RobotRecord
from kg.semantic_map import SemanticMap
from mapping.floor.book import FloorBook
from mapping.labels_map import LabelsMap
from mapping.layout import Layout
from mapping.object_mapper import ObjectChanges, ObjectMapper
from mapping.place_book import PlaceBook
from mapping.place_mapper import PlaceMapper
from mapping.places_from_objects import PlacesFromObjects
from mapping.report import FrameReport, MappingReport, StageClock
from mapping.resuming import OneMapper, as_before
from mapping.settings import ReferenceSettings
from mapping.viewpoint import map_points
from perception.frame import (
    Detections,
    Detector,
    Frame,
    Recording,
    SceneClassifier,
    SceneScores,
)

__all__ = ["FrameReport", "MappingReport", "map_recording"]

TRIES: Final = 10  # of a frame that others get in the way of

OnFrame = Callable[[FrameReport], None]
OnPicture = Callable[[Frame, Detections, SceneScores | None], None]


def map_recording(
    recording: Recording,
    semantic_map: SemanticMap,
    detector: Detector,
    scene: SceneClassifier | None = None,
    *,
    layout: Layout | None = None,
    settings: ReferenceSettings | None = None,
    on_frame: OnFrame | None = None,
    on_picture: OnPicture | None = None,
    again: bool = False,
    labels: LabelsMap | None = None,
    floor: bool = True,
) -> MappingReport:
    """Map the frames of `recording` that `semantic_map` does not hold yet; all of them if `again`.

    Each frame is one transaction: a run that ends early, by an error or by being killed, leaves
    whole frames, and the same call goes on behind them. `on_frame` hears of each frame once it is
    in the graph; `on_picture` gets each frame with its detections and, where the scene classifier
    was asked, its scores. Without a `layout` the recording gets one place that grows with what is
    seen. `labels` is a person's table of what the networks' labels mean. With `floor` the depth
    also goes into an occupancy grid of the floor (docs/floor.md).

    Raises RecordingError at the first unreadable frame, LayoutError where the layout contradicts
    the ontology or another recording of that name, or this one by another transform, lies in the
    map already, LabelsError where `labels` names what is no category, MapBusyError where somebody
    else maps the recording into a served map meanwhile. A recording that has grown
    since is stood as it was (`mapping.resuming`).
    """
    chosen, table = settings or ReferenceSettings(), labels or LabelsMap()
    table.refuse_unknown(semantic_map.catalogue)
    run = _Run(recording, semantic_map, detector, scene, layout, chosen, table, floor)
    start = 0 if again else min(run.applied, len(recording))
    views = 0
    try:
        for index, frame in run.read(start):
            report, seen, scores = run.frame(index, frame)
            views += report.place is not None
            if on_picture is not None:
                on_picture(frame, seen, scores)
            if on_frame is not None:
                on_frame(report)
    except RecordingError:
        run.finish()
        raise
    run.finish()
    return run.report(start, views)


class _Run:
    """One call of `map_recording`: the mappers, the clock, and how far it is."""

    def __init__(
        self,
        recording: Recording,
        semantic_map: SemanticMap,
        detector: Detector,
        scene: SceneClassifier | None,
        layout: Layout | None,
        settings: ReferenceSettings,
        labels: LabelsMap,
        floor: bool,
    ) -> None:
        self.clock = StageClock()
        self._done = 0
        self._alone = OneMapper(semantic_map, recording.name)
        recording, self._progress = as_before(recording, semantic_map)
        self._recording, self._map, self._settings = recording, semantic_map, settings
        self._detector, self._scene = detector, scene
        self._places = PlaceBook(semantic_map, layout, recording=recording.name)
        self._place_mapper = PlaceMapper(
            semantic_map,
            self._places,
            settings,
            model=scene.name if scene else "",
            labels=labels,
        )
        self._object_mapper = ObjectMapper(
            semantic_map,
            settings,
            self._places,
            recording=recording.name,
            model=detector.name,
            labels=labels,
        )
        self._floor = FloorBook(semantic_map) if floor else None
        self._told = (
            PlacesFromObjects(semantic_map, self._places, settings)
            if settings.places_from_objects
            else None
        )

    @property
    def applied(self) -> int:
        """Frames of the recording that the map held before this run."""
        return self._progress.frames_applied if self._progress else 0

    def read(self, start: int) -> Iterator[tuple[int, Frame]]:
        """Frames from `start` on with their index, on the clock."""
        frames = self._recording.frames(start)
        index = start
        while True:
            self.clock.next_frame()
            with self.clock.stage("read"):
                frame = next(frames, None)
            if frame is None:
                return
            yield index, frame
            index += 1

    def frame(self, index: int, frame: Frame) -> tuple[FrameReport, Detections, SceneScores | None]:
        """Map one frame and write it."""
        with self.clock.stage("detect"):
            detections = self._detector.detect(frame)
        place, scores = self._view(frame)
        if self._floor is not None:
            with self.clock.stage("floor"):
                self._floor.add(frame)
        changed = self._written(index, frame, detections)
        self._done += 1
        report = FrameReport(
            index=index,
            total=len(self._recording),
            frame=frame.id,
            detections=len(detections),
            objects=len(self._object_mapper.objects()),
            place=place,
            changed_triples=changed,
            seconds=self.clock.frame,
            frames_per_second=self._done / self.clock.elapsed(),
        )
        return report, detections, scores

    def finish(self) -> None:
        """Write what of the floor no frame was to write any more."""
        if self._floor is not None:
            self._insistently(self._write_rest)

    def _written(self, index: int, frame: Frame, detections: Detections) -> int:
        """Write what a frame shows; returns the number of triples that changed."""
        return self._insistently(lambda: self._write(index, frame, detections))

    def _insistently(self, write: Callable[[], int]) -> int:
        """`write`, again where others changed meanwhile what it was about to write.

        On a served map nobody can be kept from it. Raises ConflictError where they never rest.
        """
        for _ in range(TRIES - 1):
            try:
                return write()
            except ConflictError:
                continue
        return write()

    def _write(self, index: int, frame: Frame, detections: Detections) -> int:
        with self._map.hold():  # nobody writes between what is read and what follows from it
            self._alone.refuse_others()
            if self._floor is not None:
                self._floor.refresh()
            with self.clock.stage("map"):
                self._places.refresh()
                changes = self._object_mapper.step(frame, detections)
                if self._told is not None:
                    self._told.step(self._object_mapper.objects())
            update = self._update(index, frame, changes)
            try:
                with self.clock.stage("graph"):
                    changed = self._map.apply(update)
            except ConflictError:
                self._object_mapper.take_back(changes)
                self._places.take_back(update.places)
                self._take_back_floor(update)
                raise
            self._alone.note(update.recording)
            return changed

    def _write_rest(self) -> int:
        assert self._floor is not None
        with self._map.hold(), self.clock.stage("graph"):
            self._alone.refuse_others()
            self._floor.refresh()
            rest = self._floor.take_rest()
            if not rest:
                return 0
            update = MapUpdate(recording=self._progress, floor=rest)
            try:
                return self._map.apply(update)
            except ConflictError:
                self._take_back_floor(update)
                raise

    def _take_back_floor(self, update: MapUpdate) -> None:
        if self._floor is not None:
            self._floor.take_back(update.floor)

    def _view(self, frame: Frame) -> tuple[str | None, SceneScores | None]:
        """The place this frame was used for, and its scores; the cheap rule goes first."""
        s = self._settings
        with self.clock.stage("map"):
            self._places.refresh()
            self._places.observe(map_points(frame, s.stride, s.max_depth))
            place = self._place_mapper.viewed_place(frame) if self._scene else None
        if self._scene is None or place is None:
            return None, None
        with self.clock.stage("scene"):
            scores = self._scene.classify(frame)
        with self.clock.stage("map"):
            self._place_mapper.view(place, frame, scores)
        return place, scores

    def _update(self, index: int, frame: Frame, changes: ObjectChanges) -> MapUpdate:
        before = self._progress
        if before is None or before.frames_applied <= index:
            self._progress = RecordingRecord(
                name=self._recording.name,
                frames_applied=index + 1,
                last_frame=frame.id,
                T_map_world=self._recording.T_map_world,
                scene_model=self._scene.name if self._scene else "",
            )
        return MapUpdate(
            objects=changes.updated,
            removed=changes.removed,
            places=self._places.take_changed(),
            robot=robot_at(frame),
            recording=self._progress,
            floor=() if self._floor is None else self._floor.take_changed(frame.stamp),
        )

    def report(self, skipped: int, views: int) -> MappingReport:
        """The run so far."""
        books = self._object_mapper.labels, self._place_mapper.labels
        unknown = books[0].unknown_labels + books[1].unknown_labels
        return MappingReport(
            recording=self._recording.name,
            frames=self._done,
            skipped=skipped,
            seconds=self.clock.elapsed(),
            stage_seconds=dict(self.clock.run),
            objects=len(self._object_mapper.objects()),
            places=len(self._places.places()),
            views=views,
            unplaced=self._object_mapper.unplaced,
            unknown_labels=dict(unknown.most_common()),
            provisional=tuple(label for book in books for label in book.provisional),
        )


def robot_at(frame: Frame) -> RobotRecord:
    """Where the camera of `frame` is, and where it looks: heading [rad] of its axis from above."""
    T = frame.T_map_cam
    heading = math.atan2(float(T[1, 2]), float(T[0, 2]))
    return RobotRecord(p_map=T[:3, 3].copy(), heading=heading, stamp=frame.stamp)
