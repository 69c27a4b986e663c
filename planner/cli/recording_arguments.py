"""The recordings, networks and places that options name, opened: `map`, `live`, `evaluate map`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

from planner.cli.models import named_detector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mapping.label_table import LabelTable
    from mapping.mapper import Mode
    from mapping.objects.settings import ObjectSettings
    from mapping.places.layout import Layout
    from mapping.reference.settings import ReferenceSettings
    from perception.camera.intrinsics import Intrinsics
    from perception.frames import Detector, SceneClassifier
    from perception.live.stream import FrameStream
    from perception.recordings.listing import RecordingListing, Streams
    from perception.recordings.recording import FolderRecording

#: values of `--places` that are no file: the rooms of the mapped floor, and one place
FOUND: Final = "found"
ONE: Final = "one"
#: least score of a detection by mode; the Bayes mapper weighs weak ones
_THRESHOLDS: Final = {"bayes": 0.2, "reference": 0.4}
#: share of it from which on weaker ones are counted, for `hereabouts why --candidates`
_REPORTED: Final = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingInputs:
    """Everything a mapping run needs but frames, opened and checked before the map is touched."""

    detector: Detector
    scene: SceneClassifier | None
    layout: Layout | None
    find_places: bool  # whether rooms of the mapped floor become places
    settings: ReferenceSettings
    mode: Mode
    labels: LabelTable | None
    floor: bool  # whether depth also goes into the floor
    same_frame: bool = False  # whether the frames' world is said to be the map's
    check: bool = True  # whether depth is compared with poses
    pictures: bool = True  # whether small pictures of objects are kept
    objects: ObjectSettings | None = None  # of the Bayes mapper; None: its own

    @property
    def device(self) -> str:
        """What the networks run on; "" where there are none."""
        return str(getattr(self.detector, "device", None) or getattr(self.scene, "device", ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs(MappingInputs):
    """Everything a run reads that maps a recording."""

    recording: FolderRecording
    align: bool = False  # whether a recording new to a map is aligned with it
    corrected: bool = False  # whether its poses were given by file


def given_streams(arguments: argparse.Namespace) -> Streams:
    """The streams of a bag that the options name."""
    from perception.recordings.listing import Streams

    return Streams(
        arguments.color_topic,
        arguments.depth_topic,
        arguments.info_topic,
        arguments.pose_topic,
        arguments.map_frame,
        arguments.tolerance,
    )


def given_intrinsics(arguments: argparse.Namespace) -> Intrinsics | None:
    """Intrinsics in the file that the options name; raises RecordingError."""
    from perception.camera.intrinsics import load_intrinsics

    return load_intrinsics(Path(arguments.intrinsics)) if arguments.intrinsics else None


def open_stream(address: str, arguments: argparse.Namespace) -> FrameStream:
    """Frames of the messages that come from `address`, as the options say; RecordingError."""
    from perception.live.stream import FrameStream

    intrinsics = given_intrinsics(arguments)
    return FrameStream(address, given_streams(arguments), intrinsics, arguments.depth_scale)


def open_inputs(arguments: argparse.Namespace) -> Inputs:
    """Open and check everything a run needs; raises before any map exists or changes."""
    from perception.inference.recorded_detections import RecordedDetector

    _refuse_places(arguments)
    recording = open_given_recording(arguments)
    opened = open_mapping_inputs(arguments)
    detector = opened.detector
    if isinstance(detector, RecordedDetector):
        detector.detect(next(recording.frames()))  # of another recording: said before a map is made
    return Inputs(
        **{each.name: getattr(opened, each.name) for each in fields(MappingInputs)},
        recording=recording,
        align=arguments.align,
        corrected=arguments.poses is not None,
    )


def open_mapping_inputs(arguments: argparse.Namespace) -> MappingInputs:
    """Open and check everything a run needs but frames; raises before any map exists or changes."""
    from mapping.label_table import load_label_table
    from mapping.objects.settings import ObjectSettings
    from perception.inference.detector_pair import DetectorPair
    from perception.inference.recorded_detections import open_detector
    from perception.inference.scene_classifier import load_scene_classifier

    _refuse_places(arguments)
    threshold = _REPORTED * (arguments.threshold or min(_THRESHOLDS.values()))
    device = arguments.device
    name = _detector_file(arguments)
    detector: Detector = open_detector(name, threshold=threshold, device=device)
    if arguments.second_detector is not None:
        second = open_detector(arguments.second_detector, threshold=threshold, device=device)
        detector = DetectorPair(detector, second)
    scene = None
    if arguments.scene != "none":
        scene = load_scene_classifier(arguments.scene, device=device)
    return MappingInputs(
        detector=detector,
        scene=scene,
        layout=None if arguments.places in (None, FOUND, ONE) else _layout(arguments.places),
        find_places=_finds_places(arguments),
        settings=_settings(arguments),
        mode=arguments.mode,
        labels=load_label_table(Path(arguments.labels_map)) if arguments.labels_map else None,
        floor=arguments.floor,
        same_frame=arguments.same_frame,
        check=not arguments.no_check,
        pictures=not arguments.no_pictures,
        objects=ObjectSettings(min_score=arguments.threshold) if arguments.threshold else None,
    )


def _refuse_places(arguments: argparse.Namespace) -> None:
    if arguments.places == FOUND and not arguments.floor:
        arguments.usage_error("--places found takes the mapped floor; leave out --no-floor")


def _weighs_objects(arguments: argparse.Namespace) -> bool:
    given = arguments.places_from_objects
    return arguments.mode != "reference" if given is None else bool(given)


def _finds_places(arguments: argparse.Namespace) -> bool:
    if arguments.places is None:
        return bool(arguments.floor) and arguments.mode != "reference"
    return bool(arguments.places == FOUND)


def _layout(name: str) -> Layout:
    """The places of a file, or of that which a map_server YAML file names."""
    from mapping.places.layout import load_layout
    from planner.freespace.map_server import places_file

    path = Path(name)
    return load_layout(places_file(path) if path.suffix in (".yaml", ".yml") else path)


def _detector_file(arguments: argparse.Namespace) -> str:
    """The detector, where it is a file of that name in the recording's folder, that file."""
    name = named_detector(str(arguments.detector))
    inside = Path(arguments.recording) / name
    found = name.endswith(".json") and not Path(name).exists() and inside.exists()
    return str(inside) if found else name


def open_given_recording(
    arguments: argparse.Namespace,
    *,
    check: bool = True,
    listing: RecordingListing | None = None,
    T_map_world: NDArray[np.float64] | None = None,
) -> FolderRecording:
    """Open the recording that the options of the group "recording" describe.

    With `check` false depth is not compared with the poses; `listing` is what was read already,
    `T_map_world` (4, 4) what is known already.
    """
    from mapping.transform_file import load_transform
    from perception.recordings.recording import open_recording
    from perception.recordings.selection import Selection

    transform = T_map_world
    if arguments.sequence is not None and arguments.transform is None:
        arguments.usage_error("--sequence names a transform of the file that --transform gives")
    if arguments.transform is not None and arguments.align:
        arguments.usage_error("--transform gives what --align would search")
    if arguments.transform is not None:
        sequence = arguments.sequence or Path(arguments.recording).resolve().name
        transform = load_transform(Path(arguments.transform), sequence)
    return open_recording(
        Path(arguments.recording),
        format=arguments.format,
        name=arguments.name,
        intrinsics=given_intrinsics(arguments),
        depth_scale=arguments.depth_scale,
        up=arguments.up,
        T_map_world=transform,
        poses=Path(arguments.poses) if arguments.poses else None,
        pose_convention=arguments.pose_convention,
        check=check and not arguments.no_check,
        start_time=arguments.started,
        streams=given_streams(arguments),
        selection=Selection(
            arguments.every, arguments.limit, arguments.start, arguments.stop, arguments.keyframes
        ),
        listing=listing,
    )


def _settings(arguments: argparse.Namespace) -> ReferenceSettings:
    from mapping.reference.settings import ReferenceSettings

    return ReferenceSettings(
        min_score=arguments.threshold or _THRESHOLDS["reference"],
        estimator=arguments.estimator,
        belief_filter=arguments.filter,
        indoor_prior=arguments.prior,
        unknown_labels=arguments.unknown_labels,
        places_from_objects=_weighs_objects(arguments),
    )
