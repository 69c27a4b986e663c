"""Options of mapping and of its networks on the command line, and what they open."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

from hereabouts.cli.arguments import declare, options_of, share
from hereabouts.cli.models import named_detector
from hereabouts.cli.recording_options import (
    add_recording_arguments,
    opened_recording,
    recording_options,
)
from kg.model.errors import RecordingError
from mapping.objects.settings import ObjectSettings

if TYPE_CHECKING:
    from mapping.labels.label_resolver import LabelTable
    from mapping.looks.user_encoder import UserEncoder
    from mapping.mapping_options import MappingOptions, Mode
    from mapping.places.layout import Layout
    from perception.frames import Detector, SceneClassifier
    from perception.sources.recording import FolderRecording
    from perception.sources.recording_options import RecordingOptions

#: minimum score of reported detections, as a share of the minimum score of mapped ones: the mapper
#: counts the weaker ones for `hereabouts why --candidates`
_REPORTED: Final = 0.5
_MAPPED: Final = ObjectSettings().min_score  # minimum score of mapped detections in bayes mode

#: before the name of a topic of detections, in place of a detector's name
TOPIC: Final = "topic:"


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkOptions:
    """The networks to run, by name or file, and how."""

    detector: str = "default"
    second_detector: str | None = None  # runs on new points of view; None: no second one
    scene: str = "none"  # scene classifier
    device: str = "auto"
    head: str | None = None  # meaning of the detector's outputs; None: as its answers tell
    threshold: float = _REPORTED * _MAPPED  # score below which detectors drop detections


@dataclass(frozen=True, slots=True)
class Networks:
    """Opened networks."""

    detector: Detector
    scene: SceneClassifier | None = None

    @property
    def device(self) -> str:
        """Device on which the networks run; "" without networks."""
        return str(getattr(self.detector, "device", None) or getattr(self.scene, "device", ""))


_NETWORK_ARGUMENTS = """
--detector NAME|FILE    object detector, or a JSON file of recorded detections, here or in the
                        recording's folder; best: the best detector, downloaded if needed; live:
                        topic:NAME, detections of another program (default: the bundled ones; see
                        `hereabouts models list`)
--second-detector NAME|FILE  another detector, which runs on frames from new points of view
--head NAME             meaning of the detector's outputs, where an error names two
--threshold THRESHOLD   minimum score of a detection (default: 0.2; in reference mode: 0.4)
--device
--scene NAME|FILE|none  scene classifier (default: the bundled one)
"""


def add_network_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `network_options` reads."""
    group = parser.add_argument_group("networks")
    declare(
        group,
        _NETWORK_ARGUMENTS,
        detector={"default": "default"},
        threshold=share,
        scene={"default": "default"},
    )


def network_options(arguments: argparse.Namespace) -> NetworkOptions:
    """The networks that the arguments name."""
    threshold = _REPORTED * (arguments.threshold or _MAPPED)
    return options_of(NetworkOptions, arguments, threshold=threshold)


def open_networks(
    options: NetworkOptions, folder: str | None = None, *, live: bool = False
) -> Networks:
    """Open the networks; a file of recorded detections may be in the recording's `folder`.

    Where frames come `live` from topics, detections may, too. Raises ModelError or RecordingError.
    """
    from perception.inference.detector_pair import DetectorPair
    from perception.inference.recorded_detections import open_detector
    from perception.inference.scene_classifier import load_scene_classifier

    o, name = options, named_detector(options.detector)
    if folder is not None and name.endswith(".json") and not Path(name).exists():
        inside = Path(folder) / name
        name = str(inside) if inside.exists() else name
    detector: Detector
    if name.startswith(TOPIC) and not live:
        raise RecordingError(
            f"{name}: detections come by a topic where frames do: `live`, `search`"
        )
    if name.startswith(TOPIC):
        from perception.sources.live.topic_detector import TopicDetector

        detector = TopicDetector(name.removeprefix(TOPIC), o.threshold)
    else:
        detector = open_detector(name, threshold=o.threshold, device=o.device, head=o.head)
    if o.second_detector is not None:
        second = open_detector(o.second_detector, threshold=o.threshold, device=o.device)
        detector = DetectorPair(detector, second)
    scene = None if o.scene == "none" else load_scene_classifier(o.scene, device=o.device)
    return Networks(detector, scene)


#: values of `--mode`, the default first
MODES: Final[tuple[Mode, ...]] = ("bayes", "reference")
#: values of `--places` beside files: the rooms of the mapped floor, and a single place
FOUND: Final = "found"
ONE: Final = "one"
DEFAULT_SURFACE: Final = 0.025  # [m] side of a voxel
_REFERENCE_THRESHOLD: Final = 0.4  # minimum score of a detection in reference mode


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """A recording to map, with its networks and options."""

    path: str
    reading: RecordingOptions
    recording: FolderRecording
    networks: Networks
    options: MappingOptions
    align: bool  # whether to estimate the pose of a new recording in the map

    @property
    def corrected(self) -> bool:
        """Whether a file gives the poses."""
        return self.reading.poses is not None


def add_all_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `open_inputs` reads: of recording, networks and mapping."""
    add_recording_arguments(parser)
    add_network_arguments(parser)
    add_mapping_arguments(parser)


def open_inputs(arguments: argparse.Namespace, path: str, mode: str | None = None) -> Inputs:
    """Open and check everything that mapping `path` needs, before any map exists or changes.

    `mode` overrides `--mode`. Raises HereaboutsError.
    """
    from perception.inference.recorded_detections import RecordedDetector

    options = mapping_options(arguments, mode)
    reading = recording_options(arguments, path)
    recording = opened_recording(path, reading)
    networks = open_networks(network_options(arguments), path)
    if isinstance(networks.detector, RecordedDetector):
        networks.detector.detect(next(recording.frames()))  # raises for another recording's file
    return Inputs(
        path=path,
        reading=reading,
        recording=recording,
        networks=networks,
        options=options,
        align=arguments.align,
    )


def mapping_options(arguments: argparse.Namespace, mode: str | None = None) -> MappingOptions:
    """Options of mapping; `mode` overrides `--mode`. Raises HereaboutsError."""
    from mapping.mapping_options import MappingOptions
    from mapping.objects.settings import ObjectSettings
    from mapping.reference.settings import ReferenceSettings

    if arguments.places == FOUND and not arguments.floor:
        arguments.usage_error("--places found needs the mapped floor; leave out --no-floor")
    mode = mode or arguments.mode
    bayes, weighs_objects = mode == "bayes", arguments.places_from_objects
    threshold = arguments.threshold
    return MappingOptions(
        mode=cast("Mode", mode),
        objects=ObjectSettings() if threshold is None else ObjectSettings(min_score=threshold),
        reference=options_of(
            ReferenceSettings,
            arguments,
            min_score=threshold or _REFERENCE_THRESHOLD,
            places_from_objects=bayes if weighs_objects is None else weighs_objects,
        ),
        layout=None if arguments.places in (None, FOUND, ONE) else _layout(arguments.places),
        find_places=(arguments.places or (FOUND if bayes else ONE)) == FOUND and arguments.floor,
        labels=labels_of(arguments),
        occupancy=arguments.floor,
        same_frame=arguments.same_frame,
        check_poses=arguments.check,
        pictures=not arguments.no_pictures,
        surface=arguments.surface,
        encoder=_encoder(arguments),
    )


def labels_of(arguments: argparse.Namespace) -> LabelTable:
    """The table of `--labels-map`, checked; an empty one without it."""
    from mapping.labels.label_resolver import LabelTable, load_label_table

    return load_label_table(Path(arguments.labels_map)) if arguments.labels_map else LabelTable()


def _encoder(arguments: argparse.Namespace) -> UserEncoder | None:
    """The user's encoder, checked."""
    if arguments.encoder is None:
        return None
    if arguments.no_pictures:
        arguments.usage_error("--encoder compares pictures; leave out --no-pictures")
    from mapping.looks.user_encoder import remembered

    return remembered(arguments.encoder)


def _layout(name: str) -> Layout:
    """The places of a file, or of the file that a map_server YAML file names."""
    from mapping.places.layout import load_layout
    from planner.freespace.map_server import places_file

    path = Path(name)
    return load_layout(places_file(path) if path.suffix in (".yaml", ".yml") else path)


_MAPPING_ARGUMENTS = """
--labels-map
--unknown-labels        labels without a category: give each a provisional one (default), or ignore
                        them
--places FILE|found|one  areas of the places: GeoJSON polygons, JSON or CSV rectangles, or a
                        map_server YAML file that names one of these; found: the rooms of the mapped
                        floor; one: a single place around the viewed area (default: found; one in
                        reference mode and with --no-floor)
--mode                  mapping rules: bayes (default), or reference: the rules of the thesis
--places-from-objects   infer the kind of a place also from its objects and from how frequent each
                        kind of room is (default: yes; no in reference mode)
--floor                 map free floor, walls and furniture from depth (default: yes)
--surface CM|none       side of the coloured voxels that keep the surface of the room beside the
                        map, 1 to 20 cm (default: 2.5, or that of the map); none: no surface
--no-pictures           store no pictures of objects in the map's folder (those of people are never
                        stored)
--encoder FILES         encoder of your own, by which any text is compared with the looks of things
                        and views: image.onnx,text.onnx of CLIP, SigLIP or the like, or one file
                        with both, and tokenizer.json beside it; or a fetched one of `models list`
"""


def add_mapping_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of mapping itself that `mapping_options` reads."""
    group = parser.add_argument_group("mapping")
    declare(
        group,
        _MAPPING_ARGUMENTS,
        unknown_labels={"choices": ("provisional", "ignore"), "default": "provisional"},
        mode={"choices": MODES, "default": MODES[0]},
        places_from_objects={"action": argparse.BooleanOptionalAction},
        floor={"action": argparse.BooleanOptionalAction, "default": True},
        surface={"type": _voxel_side, "default": DEFAULT_SURFACE},
    )


def _voxel_side(text: str) -> float | None:
    """Side of a voxel [m] from `--surface`."""
    if text == "none":
        return None
    try:
        side = float(text)
    except ValueError:
        side = 0.0
    if not 1 <= side <= 20:
        raise argparse.ArgumentTypeError(
            f"must be the side of a voxel of 1 to 20 cm, or none, got {text!r}"
        )
    return side / 100
