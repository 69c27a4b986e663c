"""Mapper: the public per-frame API. Frames with poses in, one transaction of the map a frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ConflictError
from kg.model.records import (
    FloorTile,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from mapping.frames.frame_checks import FrameChecks, check_detections
from mapping.frames.pose_monitor import PoseMonitors
from mapping.frames.projection import LeadingCamera, map_points
from mapping.frames.sighting import Sighting
from mapping.keepers.scene_keepers import SceneKeepers
from mapping.labels.label_resolver import LabelResolver
from mapping.looks.known_things import NamedObject
from mapping.mapping_options import DEFAULT_OPTIONS, MappingOptions
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.detections.detection_report import BELIEVED, DetectionReport
from mapping.objects.detections.detection_reporter import DetectionReporter
from mapping.objects.object_mapper import ObjectChanges, ObjectMapper, ReferenceObjectMapper
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.places.found_places import FoundChanges, FoundPlaces, objects_elsewhere
from mapping.places.place_mapper import ObjectEvidence, PlaceMapper, update_place_views
from mapping.places.place_registry import PlaceRegistry
from mapping.relations.relation_mapper import RelationMapper
from mapping.runs.mapper_lease import MapperLease
from mapping.runs.progress_report import StageTimer
from perception.frames import Detections, Frame, SceneScores

ROOMS_INTERVAL: Final = 10.0  # [s] between two segmentations of the floor, by the frames' stamps
MAX_ATTEMPTS: Final = 10  # of a transaction that conflicts with other writers

_Change = tuple[ObjectChanges, MapUpdate]


class Mapper:
    """Mapper of one stream of frames into a map, written by this and perhaps other programs.

    Each `add` is one transaction. As a context manager it writes the rest of the occupancy map at
    the end. `timer` measures its stages.

    Args:
        semantic_map: the map, open for writing: a folder, in memory, or a served one.
        options: the rules of mapping.
        recording: name of the stream in the map. A stream of that name is continued.
        T_map_world: (4, 4) pose of the stream's world in the map; frames are in the map frame.
        detector: name of the detector, kept with each observation.
        scene_model: name of the scene classifier, kept with the stream.
        pose_estimate: how the poses were estimated from the images, kept with the stream; "" where
            they were given.
        again: whether the stream is mapped once more from its beginning.

    Raises:
        LayoutError: the layout contradicts the ontology.
        LabelsError: the label table names an unknown category.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        options: MappingOptions = DEFAULT_OPTIONS,
        *,
        recording: str = "live",
        T_map_world: NDArray[np.float64] | None = None,
        detector: str = "",
        scene_model: str = "",
        pose_estimate: str = "",
        again: bool = False,
    ) -> None:
        s = options.reference
        options.labels.check_categories(semantic_map.catalogue)
        self.timer = StageTimer()
        self.changed_triples = 0  # by the last transaction
        self._map, self._settings = semantic_map, s
        self._recording, self._scene_model = recording, scene_model
        self._pose_estimate = pose_estimate
        self._T_map_world = np.eye(4) if T_map_world is None else T_map_world
        self._lease = MapperLease(semantic_map, recording)
        self._progress = self._lease.record
        self._next = 0 if again else self.frames_applied
        find_places = options.find_places and options.occupancy
        self._places = PlaceRegistry(
            semantic_map, options.layout, recording=recording, find=find_places
        )
        self._place_mapper = PlaceMapper(
            semantic_map, self._places, s, model=scene_model, labels=options.labels
        )
        self._scene = SceneKeepers(semantic_map, options, self._places, recording, self.timer)
        self._joined: tuple[tuple[str, str], ...] = ()  # objects of the last frame
        self._objects = _object_mapper(
            semantic_map, options, self._places, self._scene, recording, detector
        )
        self._relations = RelationMapper(semantic_map, self._objects.cache)
        self._occupancy = OccupancyMap(semantic_map) if options.occupancy else None
        evidence = ObjectEvidence(semantic_map, self._places, s) if s.places_from_objects else None
        self._evidence = evidence
        self._rooms: FoundPlaces | None = None
        if find_places:
            self._rooms = FoundPlaces(semantic_map, self._places, recording=recording)
        self._rooms_at = -math.inf  # [s] stamp of the frame they were last found with
        self._found = FoundChanges()  # not written yet
        self._checks = FrameChecks(check_poses=options.check_poses)
        self._monitors = PoseMonitors(recording) if options.check_poses else None
        self._robot = LeadingCamera()
        self._reporter = DetectionReporter(semantic_map, self._objects, options.objects)
        self._observed: Frame | None = None  # the frame that the places have taken in
        self._viewed: tuple[Frame, str | None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.flush()

    def add(
        self, frame: Frame, detections: Detections, scores: SceneScores | None = None
    ) -> MapUpdate:
        """Map one frame: objects, places, occupancy and the robot's pose; returns what was written.

        `scores` count only for the place that `viewed_place` gives. After an error the map is as
        before.

        Raises:
            MapBusyError: another mapper writes the same stream.
            ConflictError: others keep writing the same things.
            RecordingError: an input is impossible (`mapping.frames.frame_checks`): depth in other
                units, no depth in the first frames, poses that are no rigid camera-to-map
                transforms, detections of another type.
        """
        with self.timer.stage("map"):
            check_detections(frame, detections, scores)
            self._observe(frame)
            if self._monitors is not None:
                self._monitors.add(frame)
        place = None if scores is None else self.viewed_place(frame)
        if scores is not None and place is not None:
            with self.timer.stage("map"):
                self._place_mapper.view(place, frame, scores)
        if self._occupancy is not None:
            with self.timer.stage("floor"):
                self._occupancy.add(frame)
        self._scene.add(frame, detections)
        self._observed = self._viewed = None
        update = self._apply(lambda: self._frame_change(self._next, frame, detections))
        self._next += 1
        self._scene.accept(update, self._joined)
        self._reporter.keep()
        return update

    def add_sightings(
        self, sightings: Sequence[Sighting], stamp: float, *, robot: RobotRecord | None = None
    ) -> MapUpdate:
        """Map detections that have positions already; returns what was written.

        As `add`, but without negative evidence, since the sensor's field of view is unknown.

        Args:
            sightings: the detections.
            stamp: when they were taken [s since 1970].
            robot: pose of the robot then, which is stored; sightings of a thing from one spot
                count less each time.
        """

        def change() -> _Change:
            with self.timer.stage("map"):
                where = None if robot is None else robot.p_map[:2]
                changes = self._objects.add_sightings(sightings, stamp, robot=where)
                changes = self._relations.update(changes)
            update = MapUpdate(changes.updated, changes.removed, robot=robot)
            return changes, replace(update, departed=changes.departed)

        applied = self._apply(change)
        self._reporter.keep()
        return applied

    def viewed_place(self, frame: Frame) -> str | None:
        """IRI of the place whose category belief the scene scores of `frame` would update.

        None: they would not count (little depth, several places in view, a repeated view), so the
        scene classifier can be skipped. Raises RecordingError where `add` would.
        """
        if self._viewed is None or self._viewed[0] is not frame:
            with self.timer.stage("map"):
                self._observe(frame)
                self._viewed = frame, self._place_mapper.viewed_place(frame)
        return self._viewed[1]

    def flush(self) -> None:
        """Write the rest: occupancy map, boxes, rooms of the whole floor, and detections."""
        self._apply(self._rest_of_occupancy)
        self._apply(self._rest_of_objects)
        self._apply(self._rest_of_rooms)
        self._apply(self._rest_of_things)
        self._scene.finish()
        if self._monitors is not None:
            self._monitors.finish()
        self._reporter.finish()

    def objects(self) -> tuple[ObjectRecord, ...]:
        """All objects of the map, with assertions applied."""
        return self._objects.objects()

    def believed(self) -> int:
        """The number of objects that are believed, as the query `objects` lists them."""
        return sum(round(record.existence, 2) >= BELIEVED for record in self.objects())

    def places(self) -> tuple[PlaceRecord, ...]:
        """All places of the map, as perception believes them."""
        return self._places.places()

    def detection_report(self) -> DetectionReport:
        """Fates of all detections, and the things that were seen but are not believed.

        The folder of a map keeps the report (`detections.json`); later runs add to its counts.
        """
        return self._reporter.report()

    @property
    def frames_applied(self) -> int:
        """Frames of the stream that the map holds."""
        return self._progress.frames_applied if self._progress else 0

    @property
    def looked_from(self) -> dict[str, NDArray[np.float64]]:
        """Pose (4, 4) of the last frame that each detector ran on, by name; earlier runs count."""
        return self._objects.looked_from

    @property
    def problems(self) -> tuple[str, ...]:
        """Problems of poses, surface and known things so far, one line for each kind."""
        poses = () if self._monitors is None else self._monitors.problems
        return poses + self._scene.problems

    @property
    def recognised(self) -> tuple[NamedObject, ...]:
        """Known things that were recognised, once all is flushed."""
        pictures = self._scene.pictures
        return () if pictures is None else pictures.recognised

    @property
    def unplaced(self) -> int:
        """Detections so far without usable depth."""
        return self._objects.unplaced

    @property
    def label_resolvers(self) -> tuple[LabelResolver, LabelResolver]:
        """Resolvers of the detector's and of the scene classifier's labels, with unknown labels."""
        return self._objects.labels, self._place_mapper.labels

    def _observe(self, frame: Frame) -> None:
        if self._observed is not frame:
            self._checks.check(frame)
            self._places.refresh()
            if self._places.grows:
                s = self._settings
                self._places.observe(map_points(frame, s.stride, s.max_depth))
            self._observed = frame

    def _frame_change(self, index: int, frame: Frame, detections: Detections) -> _Change:
        if self._rooms is not None and frame.stamp >= self._rooms_at + ROOMS_INTERVAL:
            with self.timer.stage("floor"):
                self._found = self._found.followed_by(self._rooms.update())
            self._rooms_at = frame.stamp
        with self.timer.stage("map"):
            changes = self._relations.update(self._objects.add(frame, detections))
            if self._evidence is not None:
                self._evidence.update(self._objects.objects())
        if self.frames_applied <= index:
            self._progress = RecordingRecord(
                name=self._recording,
                frames_applied=index + 1,
                last_frame=frame.id,
                T_map_world=self._T_map_world,
                scene_model=self._scene_model,
                pose_estimate=self._pose_estimate,
                detects=self._objects.labels.detects,
            )
        floor = () if self._occupancy is None else self._occupancy.take_changed(frame.stamp)
        self._view_places(floor)
        self._joined = changes.joined
        return changes, MapUpdate(
            objects=changes.updated,
            removed=(*changes.removed, *self._found.removed),
            places=self._places.take_changed(),
            doors=self._found.doors,
            robot=self._robot.at(frame),
            recording=self._progress,
            floor=floor,
            departed=changes.departed,
        )

    def _view_places(self, floor: Sequence[FloorTile]) -> None:
        if self._occupancy is not None:
            update_place_views(self._places, self._occupancy, floor)

    def _rest_of_occupancy(self) -> _Change | None:
        rest = () if self._occupancy is None else self._occupancy.take_rest()
        if not rest:
            return None
        self._view_places(rest)
        places = self._places.take_changed()
        return ObjectChanges(), MapUpdate(places=places, recording=self._progress, floor=rest)

    def _rest_of_objects(self) -> _Change | None:
        with self.timer.stage("map"):
            changes = self._objects.finish()
            if not changes.updated:
                return None
            changes = self._relations.update(changes)
        return changes, MapUpdate(changes.updated, recording=self._progress)

    def _rest_of_things(self) -> _Change | None:
        changes = self._scene.things(self._objects.objects())
        if not changes.updated and not changes.removed:
            return None
        things = self._relations.of_things(changes.updated)
        return ObjectChanges(), MapUpdate(things, changes.removed, recording=self._progress)

    def _rest_of_rooms(self) -> _Change | None:
        if self._rooms is None:
            return None
        with self.timer.stage("floor"):
            self._found = self._found.followed_by(self._rooms.update())
            moved = objects_elsewhere(self._map, self._places)
            self._view_places(self._map.floor())
        places = self._places.take_changed()
        removed, doors = self._found.removed, self._found.doors
        return ObjectChanges(), MapUpdate(moved, removed, places, None, self._progress, doors=doors)

    def _apply(self, change: Callable[[], _Change | None]) -> MapUpdate:
        """Optimistic transaction: computed and written again where it conflicts with others."""
        for _ in range(MAX_ATTEMPTS - 1):
            with suppress(ConflictError):
                return self._try(change)
        return self._try(change)

    def _try(self, change: Callable[[], _Change | None]) -> MapUpdate:
        with self._map.hold():  # nobody else writes between reading and writing
            self._lease.check()
            if self._occupancy is not None:
                self._occupancy.refresh()
            changed = change()
            if changed is None:
                return MapUpdate()
            changes, update = changed
            try:
                self._scene.save(self._map.sequence + 1)
                with self.timer.stage("graph"):
                    self._objects.save(self._map.sequence + 1)
                    written = self._map.apply(update)
                    self.changed_triples = len(written) if written else 0
            except ConflictError:
                self._objects.undo(changes)
                self._places.undo(update.places)
                if self._occupancy is not None:
                    self._occupancy.undo(update.floor)
                raise
            self._found = FoundChanges()
            self._lease.renew(update.recording)
            return update


def _object_mapper(
    semantic_map: SemanticMap,
    options: MappingOptions,
    places: PlaceRegistry,
    scene: SceneKeepers,
    recording: str,
    detector: str,
) -> ObjectMapper:
    """The object mapper of the mode in `options`."""
    s = options.reference
    if options.mode == "reference":
        return ReferenceObjectMapper(
            semantic_map, s, places, recording=recording, model=detector, labels=options.labels
        )
    return BayesObjectMapper(
        semantic_map,
        options.objects,
        places,
        recording=recording,
        model=detector,
        labels=options.labels,
        unknown_labels=s.unknown_labels,
        voxels=scene.voxels,
        looks=scene.looks,
    )
