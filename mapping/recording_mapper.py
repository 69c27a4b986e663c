"""Recording mapper: a loop over `mapping.mapper.Mapper`, with networks, resumption and progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import RecordingError
from mapping.alignment.recording_fit import fitted
from mapping.frames.lone_frames import without_lone
from mapping.frames.read_ahead import AHEAD, read_ahead
from mapping.mapper import Mapper
from mapping.mapping_options import DEFAULT_OPTIONS, MappingOptions
from mapping.runs.progress_report import FrameReport, MappingReport
from mapping.runs.resumption import resumed
from perception.frames import (
    NO_DETECTIONS,
    Detections,
    Detector,
    Frame,
    Recording,
    SceneClassifier,
    SceneScores,
)
from perception.inference.detector_pair import DetectorPair
from perception.sources.live.live_recording import LiveRecording
from perception.sources.recording import FolderRecording

OnFrame = Callable[[FrameReport], None]
OnDetections = Callable[[Frame, Detections, SceneScores | None], None]


def map_recording(
    recording: Recording,
    semantic_map: SemanticMap,
    detector: Detector,
    scene: SceneClassifier | None = None,
    options: MappingOptions = DEFAULT_OPTIONS,
    *,
    again: bool = False,
    on_frame: OnFrame | None = None,
    on_detections: OnDetections | None = None,
    ahead: int = AHEAD,
) -> MappingReport:
    """Map the frames of `recording` that `semantic_map` does not hold yet; all of them if `again`.

    Three threads read frames, detect and map side by side, and two more describe key views and look
    for things without a name. All keep the recording's order, so that the map is the same as with
    one thread. Each frame is one transaction: a run that ends early, by an error or by being
    killed, leaves whole frames, and the same call continues after them. A recording that has grown
    since keeps its transform (`mapping.runs.resumption`).

    Args:
        recording: the frames, with their poses.
        semantic_map: the map, open for writing.
        detector: detects the objects of each frame.
        scene: classifies the scene of the frames that show one place.
        options: the rules of mapping.
        again: whether frames that the map holds are mapped once more.
        on_frame: called after each frame is written.
        on_detections: called with each frame, its detections of at least `options.min_score`, and
            its scene scores where the classifier ran.
        ahead: number of frames that are read, and detected in, before they are needed.

    Raises:
        RecordingError: a frame is unreadable; those before it are mapped.
        LayoutError: the layout contradicts the ontology; or the map holds another recording of
            that name, or this one by another transform; or the recording is new and does not fit
            the map's others, or is not recognised there (`mapping.alignment.recording_fit`).
        LabelsError: the label table names an unknown category.
        MapBusyError: another program maps the recording into a served map meanwhile.
    """
    options.labels.check_categories(semantic_map.catalogue)
    recording = resumed(recording, semantic_map)
    recording, fit = fitted(recording, semantic_map, same_frame=options.same_frame)
    mapper = Mapper(
        semantic_map,
        options,
        recording=recording.name,
        T_map_world=recording.T_map_world,
        detector=detector.name,
        scene_model=scene.name if scene else "",
        pose_estimate=_pose_estimate(recording, semantic_map, fit),
        again=again,
    )
    mapper.label_resolvers[0].network = tuple(getattr(detector, "labels", ()))
    start = 0 if again else min(mapper.frames_applied, len(recording))
    if start and isinstance(detector, DetectorPair):
        detector.resume(mapper.looked_from)
    run = _Run(mapper, recording, detector, scene, fit, ahead, options.check_poses)
    try:
        with closing(read_ahead(run.detect(start), ahead)) as detected:
            for index, one in enumerate(detected, start):
                report, scores = run.map(index, one)
                if on_detections is not None:
                    strong = np.flatnonzero(one.detections.score >= options.min_score)
                    on_detections(one.frame, one.detections.chosen(strong), scores)
                if on_frame is not None:
                    on_frame(report)
    except RecordingError:
        mapper.flush()
        raise
    mapper.flush()
    return run.report(start)


def _pose_estimate(recording: Recording, semantic_map: SemanticMap, fit: str) -> str:
    """How the poses were estimated, and how the recording was placed; "" where they were given."""
    if isinstance(recording, LiveRecording):
        return recording.pose_estimate
    if not isinstance(recording, FolderRecording) or recording.estimate is None:
        return ""
    before = [r.pose_estimate for r in semantic_map.recordings() if r.name == recording.name]
    if before:
        return before[0]
    placed = fit.removeprefix(f"{recording.name} was ")
    return "; ".join(line for line in (recording.estimate.summary(), placed) if line)


@dataclass(frozen=True, slots=True)
class _DetectedFrame:
    """A frame with its detections, and how long both took."""

    frame: Frame
    detections: Detections
    read: float  # [s]
    detect: float  # [s]


@dataclass(slots=True)
class _Run:
    """One call of `map_recording`."""

    mapper: Mapper
    recording: Recording
    detector: Detector
    scene: SceneClassifier | None
    fit: str  # one line on how the recording fits the map; "" without others
    ahead: int  # frames that a stage is ahead of the next
    checks: bool  # whether lone frames are left out ...
    left_out: dict[tuple[str, str], str] = field(default_factory=dict)  # ... and lines on them
    frames: int = 0
    views: int = 0  # frames that counted for a place

    def read(self, start: int) -> Iterator[tuple[Frame, float]]:
        """Frames from `start` on, each with the seconds that reading it took."""
        frames = self.recording.frames(start)
        if self.checks:
            frames = without_lone(frames, self.recording.name, self.left_out)
        before = time.perf_counter()
        for frame in frames:
            yield frame, time.perf_counter() - before
            before = time.perf_counter()

    def detect(self, start: int) -> Iterator[_DetectedFrame]:
        """Frames from `start` on with their detections."""
        with closing(read_ahead(self.read(start), self.ahead)) as frames:
            for frame, read in frames:
                before = time.perf_counter()
                detections = NO_DETECTIONS if frame.blank else self.detector.detect(frame)
                yield _DetectedFrame(frame, detections, read, time.perf_counter() - before)

    def map(self, index: int, detected: _DetectedFrame) -> tuple[FrameReport, SceneScores | None]:
        """Run the scene classifier on one frame where it counts, and map it."""
        timer, frame, detections = self.mapper.timer, detected.frame, detected.detections
        timer.next_frame()
        timer.count("read", detected.read)
        timer.count("detect", detected.detect)
        place, scores = None, None
        if self.scene is not None and not frame.blank:
            place = self.mapper.viewed_place(frame)
            if place is not None:
                with timer.stage("scene"):
                    scores = self.scene.classify(frame)
        self.mapper.add(frame, detections, scores)
        self.frames += 1
        self.views += place is not None
        report = FrameReport(
            index=index,
            total=len(self.recording),
            frame=frame.id,
            detections=len(detections),
            objects=self.mapper.believed(),
            place=place,
            changed_triples=self.mapper.changed_triples,
            seconds=timer.frame,
            frames_per_second=self.frames / timer.elapsed(),
        )
        return report, scores

    def report(self, skipped: int) -> MappingReport:
        """Report of the whole run."""
        mapper = self.mapper
        resolvers = mapper.label_resolvers
        detected = mapper.detection_report()
        unknown = resolvers[0].unknown_labels + resolvers[1].unknown_labels
        return MappingReport(
            recording=self.recording.name,
            frames=self.frames,
            skipped=skipped,
            seconds=mapper.timer.elapsed(),
            stage_seconds=dict(mapper.timer.run),
            objects=mapper.believed(),
            places=len(mapper.places()),
            views=self.views,
            unplaced=mapper.unplaced,
            unknown_labels=dict(unknown.most_common()),
            provisional=tuple(label for resolver in resolvers for label in resolver.provisional),
            problems=(*mapper.problems, *self.left_out.values()),
            recognised={one.iri: one.name for one in mapper.recognised},
            fit=self.fit,
            doubted=detected.doubted,
            most_probable=detected.things[: detected.doubted],
        )
