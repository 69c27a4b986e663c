"""Arguments that say which recording, which networks and which places: `map` and `bench map`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from planner.commands.arguments import positive

if TYPE_CHECKING:
    from mapping.labels_map import LabelsMap
    from mapping.layout import Layout
    from mapping.settings import ReferenceSettings
    from perception.frame import Detector, Recording, SceneClassifier


@dataclass(frozen=True, slots=True)
class Inputs:
    """Everything a mapping run reads, opened and checked before the map is touched."""

    recording: Recording
    detector: Detector
    scene: SceneClassifier | None
    layout: Layout | None
    settings: ReferenceSettings
    labels: LabelsMap | None
    floor: bool  # whether depth also goes into the floor


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `open_inputs` reads."""
    parser.set_defaults(usage_error=parser.error)
    camera = parser.add_argument_group("recording")
    camera.add_argument(
        "--format",
        default="auto",
        help="auto, tum, 7scenes, trajectory-log or hololens (default: auto)",
    )
    camera.add_argument("--name", help="name of the recording in the map (default: its folder)")
    camera.add_argument("--intrinsics", metavar="FILE", help="intrinsics.json, .txt or K.txt")
    camera.add_argument(
        "--depth-scale", type=positive, metavar="N", help="depth units in a metre, e.g. 1000"
    )
    camera.add_argument(
        "--up",
        metavar="AXIS",
        help="the world's up: x, y, z, -x, -y, -z or a vector A,B,C (default: read, else found)",
    )
    camera.add_argument("--transform", metavar="FILE", help="JSON of world-to-map transforms")
    camera.add_argument("--sequence", metavar="NAME", help="which transform of that file")
    networks = parser.add_argument_group("networks")
    networks.add_argument(
        "--detector",
        default="default",
        metavar="NAME|FILE",
        help="object detector (default: the bundled one; see `hereabouts models list`)",
    )
    networks.add_argument(
        "--threshold", type=positive, default=0.4, help="least detector score (default: 0.4)"
    )
    networks.add_argument(
        "--scene",
        default="default",
        metavar="NAME|FILE|none",
        help="scene classifier (default: the bundled one)",
    )
    networks.add_argument(
        "--labels-map",
        metavar="FILE",
        help="CSV of what labels mean: label,category a line, category - to ignore the label",
    )
    networks.add_argument(
        "--unknown-labels",
        choices=("provisional", "ignore"),
        default="provisional",
        help="what becomes of labels that no category is called (default: a provisional category)",
    )
    places = parser.add_argument_group("mapping")
    places.add_argument(
        "--places",
        metavar="FILE",
        help="rectangles of the places, JSON or CSV (default: one place around what is seen)",
    )
    places.add_argument(
        "--mode", choices=("reference",), default="reference", help="mapping rules (the thesis')"
    )
    places.add_argument(
        "--estimator",
        choices=("fd", "scott", "doane"),
        default="fd",
        help="histogram bins: Freedman-Diaconis, Scott or Doane (default: fd)",
    )
    places.add_argument(
        "--filter",
        choices=("mean", "bayes"),
        default="mean",
        help="belief filter of place categories (default: mean)",
    )
    places.add_argument(
        "--prior", action="store_true", help="only the thesis' 21 indoor place categories"
    )
    places.add_argument(
        "--places-from-objects",
        action="store_true",
        help="objects count in what a place is believed to be, beside the scene classifier",
    )
    places.add_argument(
        "--floor",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="map free floor, walls and furniture from depth (default: yes)",
    )


def open_inputs(arguments: argparse.Namespace) -> Inputs:
    """Open and check everything a run needs; raises before any map exists or changes."""
    from mapping.labels_map import load_labels_map
    from mapping.layout import load_layout
    from mapping.transform import load_transform
    from perception.detector import load_detector
    from perception.intrinsics import load_intrinsics
    from perception.recording import open_recording
    from perception.scene import load_scene_classifier

    transform = None
    if arguments.sequence is not None and arguments.transform is None:
        arguments.usage_error("--sequence names a transform of the file that --transform gives")
    if arguments.transform is not None:
        sequence = arguments.sequence or Path(arguments.recording).resolve().name
        transform = load_transform(Path(arguments.transform), sequence)
    recording = open_recording(
        Path(arguments.recording),
        format=arguments.format,
        name=arguments.name,
        intrinsics=load_intrinsics(Path(arguments.intrinsics)) if arguments.intrinsics else None,
        depth_scale=arguments.depth_scale,
        up=arguments.up,
        T_map_world=transform,
    )
    return Inputs(
        recording=recording,
        detector=load_detector(arguments.detector, threshold=arguments.threshold),
        scene=None if arguments.scene == "none" else load_scene_classifier(arguments.scene),
        layout=load_layout(Path(arguments.places)) if arguments.places else None,
        settings=_settings(arguments),
        labels=load_labels_map(Path(arguments.labels_map)) if arguments.labels_map else None,
        floor=arguments.floor,
    )


def _settings(arguments: argparse.Namespace) -> ReferenceSettings:
    from mapping.settings import ReferenceSettings

    return ReferenceSettings(
        estimator=arguments.estimator,
        belief_filter=arguments.filter,
        indoor_prior=arguments.prior,
        unknown_labels=arguments.unknown_labels,
        places_from_objects=arguments.places_from_objects,
    )
