"""Pose correction: moves everything mapped by corrected poses, of a recording or a live camera.

The recording is mapped into a temporary map by the corrected poses. One transaction then replaces
its part of the map. Objects keep their identity where their evidence, moved with its frame, shows
the same object; so do places. Floor is replaced where it came from the old poses. Assertions of
people and facts from other recordings stay.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import UNKNOWN, FloorTile, MapUpdate, ObjectRecord, RecordingRecord
from mapping.alignment.recording_fit import temporary_map
from mapping.alignment.search import floor_tiles
from mapping.key_views.view_store import ViewStore
from mapping.mapper import Mapper
from mapping.mapping_options import DEFAULT_OPTIONS, MappingOptions
from mapping.objects.association import assign
from mapping.objects.sightings import intersection_over_union
from mapping.occupancy.tiles import States
from mapping.places.layout import Layout
from mapping.places.place_registry import PlaceRegistry
from mapping.runs.mapper_lease import MapperLease
from mapping.runs.progress_report import MappingReport
from mapping.runs.resumption import resumed
from perception.frames import Frame, Recording
from perception.sources.live.live_recording import KeptFrames, LiveRecording
from perception.sources.recording import FolderRecording

Floats = NDArray[np.float64]

GATE: Final = 0.75  # [m] between an object where its frame puts it and its new mapping
OTHERS: Final = 0.5  # [m] within which an object that another recording brought is the same
STAYS: Final = 0.1  # [m] that an object of several recordings moves without being mapped again
SAME_BOX: Final = 0.5  # IoU of two boxes of one frame that show one thing


@dataclass(frozen=True, slots=True)
class CorrectionReport:
    """Report of a correction of poses."""

    recording: str
    frames: int
    kept: int  # objects that are the same
    distance: float  # [m] median of what they moved by
    new: int
    removed: int
    tiles: int  # of the floor

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        values = asdict(self)
        distance, tiles = values.pop("distance"), values.pop("tiles")
        return values | {"median_distance": round(distance, 3), "floor_tiles": tiles}

    def summary(self) -> str:
        """One line."""
        return f"{self.recording} has its corrected poses: {self.changes()}"

    def changes(self) -> str:
        """Counts of objects and tiles that moved or changed, as the end of a line."""
        return (
            f"{self.kept} objects moved by {self.distance:.2f} m (median), {self.new} new, "
            f"{self.removed} gone, {self.tiles} floor tiles changed"
        )


def is_mapped(recording: FolderRecording, semantic_map: SemanticMap) -> bool:
    """Whether the map holds frames of that recording."""
    return any(r.name == recording.name and r.frames_applied for r in semantic_map.recordings())


def correct_poses(
    recording: FolderRecording,
    previous: FolderRecording,
    semantic_map: SemanticMap,
    remap: Callable[[FolderRecording, SemanticMap], MappingReport],
    options: MappingOptions = DEFAULT_OPTIONS,
) -> CorrectionReport:
    """Replace a recording's part of `semantic_map` by the result of its corrected poses.

    `previous` is the same recording by the poses it was mapped with; `remap` maps one into a map.
    The corrected poses are in the recording's own world, whose transform into the map is kept.
    With `options.find_places` the rooms of the new floor are found in a second transaction.
    Raises what `remap` does, LayoutError where another recording of that name is in the map, and
    MapBusyError where another program maps the recording meanwhile; the map is then untouched.
    """
    lease = MapperLease(semantic_map, recording.name)
    recording, previous = _placed(recording, semantic_map), _placed(previous, semantic_map)
    with temporary_map(semantic_map) as temporary:
        report = remap(recording, temporary)
        semantic_map.ontology.learn(report.provisional, "object", model="")
        (progress,) = temporary.recordings()
        with semantic_map.hold():
            lease.check()
            correction = _Correction(recording, previous, semantic_map, temporary)
            update = correction.update(progress, options.layout)
            semantic_map.apply(update)
            here, new = semantic_map.surface_store, temporary.surface_store
            if here is not None and new is not None:
                here.replace(recording.name, new, semantic_map.sequence)
            if (folder := semantic_map.store.path) is not None:
                views = ViewStore(folder, semantic_map.sequence)
                views.move(recording.name, _motions(previous, recording))
                views.close()
    if options.find_places:
        with Mapper(semantic_map, options, recording=recording.name):
            pass  # at its end it finds the rooms of all floor
    return correction.report(update, report.frames)


def _placed(recording: FolderRecording, semantic_map: SemanticMap) -> FolderRecording:
    placed = resumed(recording, semantic_map)
    assert isinstance(placed, FolderRecording)
    return placed


class _Correction:
    def __init__(
        self,
        recording: FolderRecording,
        previous: FolderRecording,
        semantic_map: SemanticMap,
        temporary: SemanticMap,
    ) -> None:
        self._recording, self._previous = recording, previous
        self._map, self._temporary = semantic_map, temporary
        self._alone = len([r for r in semantic_map.recordings() if r.frames_applied]) == 1
        self._motion = _motions(previous, recording)
        records = semantic_map.recordings()
        self._estimate = next(r.pose_estimate for r in records if r.name == recording.name)
        self._distances = list[float]()
        self._new = 0
        self._iris = dict[str, str]()  # of objects: in the temporary map -> in the map

    def update(self, progress: RecordingRecord, layout: Layout | None) -> MapUpdate:
        """Everything that changes."""
        places = PlaceRegistry(self._map, layout, recording=self._recording.name)
        kept, removed = self._objects()
        known = {record.label: record for record in places.places()}
        for record in self._temporary.perceived.places():
            old = known.get(record.label)
            if old is not None and (self._alone or record.label == self._recording.name):
                views = record.from_views
                places.put(
                    replace(
                        record, iri=old.iri, beliefs=views, scene_beliefs={}, evidence_objects=()
                    )
                )
        objects = tuple(replace(record, place=places.at(record.p_map)) for record in kept)
        objects = tuple(self._related(record) for record in objects)
        return MapUpdate(
            objects=objects,
            removed=removed,
            places=places.take_changed(),
            robot=self._temporary.robot(),
            recording=replace(
                progress, T_map_world=self._recording.T_map_world, pose_estimate=self._estimate
            ),
            floor=self._floor(),
        )

    def report(self, update: MapUpdate, frames: int) -> CorrectionReport:
        """Report of the changes in `update`."""
        return CorrectionReport(
            recording=self._recording.name,
            frames=frames,
            kept=len(self._distances),
            distance=float(np.median(self._distances)) if self._distances else 0.0,
            new=self._new,
            removed=len(update.removed),
            tiles=len(update.floor),
        )

    def _objects(self) -> tuple[list[ObjectRecord], tuple[str, ...]]:
        """Objects to write, and IRIs of those that leave."""
        held = self._map.perceived.objects()
        name = self._recording.name
        own = [o for o in held if o.evidence and o.evidence.recording == name]
        others = [o for o in held if not (o.evidence and o.evidence.recording == name)]
        found = self._temporary.perceived.objects()
        asserted = {assertion.subject for assertion in self._map.assertions.all()}
        moved = [self._moved(record) for record in own]
        pairs = assign(_costs(moved, found))
        self._iris = {found[column].iri: own[row].iri for row, column in pairs.items()}
        written = [
            replace(
                found[column],
                iri=own[row].iri,
                first_seen=own[row].first_seen,
                last_seen=own[row].last_seen,
            )
            for row, column in pairs.items()
        ]
        self._distances = [
            float(np.linalg.norm(found[column].p_map - own[row].p_map))
            for row, column in pairs.items()
        ]
        matched = set(pairs.values())
        for column, record in enumerate(found):
            if column not in matched and not _is_one_of(record, others):
                self._iris[record.iri] = self._map.new_object_iri()
                written.append(replace(record, iri=self._iris[record.iri]))
                self._new += 1
        left = [row for row in range(len(own)) if row not in pairs]
        stays = {
            row for row in left if own[row].iri in asserted or self._stays(own[row], moved[row])
        }
        written += [moved[row] for row in left if row in stays]
        return written, tuple(own[row].iri for row in left if row not in stays)

    def _stays(self, old: ObjectRecord, moved: ObjectRecord) -> bool:
        """Whether an object not mapped again stays: others may have seen it where it is."""
        return not self._alone and float(np.linalg.norm(moved.p_map - old.p_map)) < STAYS

    def _related(self, record: ObjectRecord) -> ObjectRecord:
        """The object with relations to objects of the map, where it was mapped anew."""
        if record.iri not in self._iris.values():
            return replace(record, relations=None)
        kept = [r for r in record.relations or () if r.target in self._iris]
        return replace(
            record, relations=tuple(replace(r, target=self._iris[r.target]) for r in kept)
        )

    def _moved(self, record: ObjectRecord) -> ObjectRecord:
        """The object where the frame of its evidence puts it now."""
        motion = self._motion.get(record.evidence.frame if record.evidence else "")
        if motion is None:
            return record
        return replace(record, p_map=motion[:3, :3] @ record.p_map + motion[:3, 3])

    def _floor(self) -> tuple[FloorTile, ...]:
        """Tiles that change: the old poses' states give way to the new ones'."""
        before = {_key(tile): tile for tile in self._map.floor()}
        after = {_key(tile): tile for tile in self._temporary.floor()}
        if not after:
            return ()
        was = {} if self._alone else floor_tiles(self._previous.frames())
        changed = list[FloorTile]()
        stamp = max(tile.changed for tile in after.values())
        for key in {**before, **after}:
            tile = before.get(key) or after[key]
            states = _replaced(
                tile.cells if key in before else None,
                after[key].cells if key in after else np.full_like(tile.cells, UNKNOWN),
                tile.cells if self._alone else was.get(key[1:]),
            )
            if key not in before or not np.array_equal(states, tile.cells):
                viewed = (after.get(key) or tile).viewed
                changed.append(replace(tile, cells=states, changed=stamp, viewed=viewed))
        return tuple(changed)


def _motions(previous: FolderRecording, recording: FolderRecording) -> dict[str, Floats]:
    """Correction (4, 4) in the map of what each frame showed, by the frame's id."""
    old = {entry.id: entry.T_world_cam for entry in previous.listing.entries}
    T = recording.T_map_world
    back = np.linalg.inv(previous.T_map_world)
    return {
        entry.id: T @ entry.T_world_cam @ np.linalg.inv(old[entry.id]) @ back
        for entry in recording.listing.entries
        if entry.id in old
    }


def _costs(moved: Sequence[ObjectRecord], found: Sequence[ObjectRecord]) -> Floats:
    """Cost of each pair of an object, moved with its frame, and a newly mapped one."""
    cost = np.full((len(moved), len(found)), np.inf)
    for row, old in enumerate(moved):
        for column, new in enumerate(found):
            distance = float(np.linalg.norm(old.p_map - new.p_map))
            if _one_box(old, new):
                cost[row, column] = 0.01 * distance
            elif old.category == new.category and distance < GATE:
                cost[row, column] = distance
    return cost


def _one_box(a: ObjectRecord, b: ObjectRecord) -> bool:
    """Whether the evidence of both is one box of one frame."""
    return (
        a.evidence is not None
        and b.evidence is not None
        and a.evidence.frame == b.evidence.frame
        and intersection_over_union(a.evidence.box, b.evidence.box) >= SAME_BOX
    )


def _is_one_of(record: ObjectRecord, others: Sequence[ObjectRecord]) -> bool:
    return any(
        other.category == record.category
        and float(np.linalg.norm(other.p_map - record.p_map)) < OTHERS
        for other in others
    )


def _key(tile: FloorTile) -> tuple[int, int, int]:
    return tile.storey, tile.column, tile.row


def _replaced(held: States | None, new: States, was: States | None) -> States:
    """States of a tile: `new` where `held` is unknown or what the old poses made of it."""
    if held is None or held.shape != new.shape:
        return new
    ours = held == UNKNOWN
    if was is not None and was.shape == held.shape:
        ours |= held == was
    return np.where(ours, new, held)


MOVED: Final = 0.03  # [m] by which loops move the camera before what was mapped follows
REST: Final = 10.0  # times as long as the last correction took, until the next one begins


MapInto = Callable[[Recording, SemanticMap, MappingOptions], MappingReport]


@dataclass(slots=True)
class LiveCorrection:
    """Corrections of what one live recording mapped, while it goes on and at its end."""

    recording: LiveRecording
    kept: KeptFrames
    corrections: int = 0  # so far
    _next: float = 0.0  # [s] when the next one may begin

    def keep(self, frame: Frame) -> None:
        """Keep a frame that was mapped just now."""
        if self.recording.corrector is not None:
            self.kept.add(frame)

    def run(
        self,
        semantic_map: SemanticMap,
        map_into: MapInto,
        options: MappingOptions,
        tell: Callable[[str], None],
    ) -> MappingReport:
        """Map the live recording until its end; the map follows the loops, with a line each time.

        `map_into` maps a recording, the live one or its kept frames, into a map. Raises what
        `map_into` and `correct_poses` do.
        """
        self.recording.pauses = self._is_due
        report = None
        while True:
            part = map_into(self.recording, semantic_map, options)
            report = part if report is None else report.followed_by(part)
            if self._is_needed():
                moved = self._moved()
                changes = self._correct(semantic_map, map_into, options).changes()
                tell(f"the path was corrected by up to {moved:.2f} m: {changes}")
            if not self.recording.paused:
                return report

    def _moved(self) -> float:
        corrector = self.recording.corrector
        return 0.0 if corrector is None else corrector.moved

    def _is_needed(self) -> bool:
        """Whether loops moved what was mapped, and all of its frames are kept."""
        return self.kept.whole and len(self.kept) > 0 and self._moved() > MOVED

    def _is_due(self) -> bool:
        return self._is_needed() and time.monotonic() >= self._next

    def _correct(
        self, semantic_map: SemanticMap, map_into: MapInto, options: MappingOptions
    ) -> CorrectionReport:
        before, live = time.monotonic(), self.recording
        T, poses = live.T_map_world, live.corrected_poses()
        without_rooms, estimated = replace(options, find_places=False), live.tracker is not None
        report = correct_poses(
            self.kept.recording(live.name, T, poses, estimated=estimated),
            self.kept.recording(live.name, T, estimated=estimated),
            semantic_map,
            lambda frames, apart: map_into(frames, apart, without_rooms),
            options,
        )
        self.kept.moved(poses)
        self.corrections += 1
        now = time.monotonic()
        self._next = now + REST * (now - before)
        return report
