"""Options of mapping on the command line: arguments, and `MappingOptions` made of them."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

from hereabouts.cli.network_options import (
    Networks,
    add_network_arguments,
    network_options,
    open_networks,
)
from hereabouts.cli.recording_options import (
    add_recording_arguments,
    opened_recording,
    recording_options,
)

if TYPE_CHECKING:
    from mapping.looks.user_encoder import UserEncoder
    from mapping.mapping_options import MappingOptions, Mode
    from mapping.places.layout import Layout
    from perception.sources.recording import FolderRecording
    from perception.sources.recording_options import RecordingOptions

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
    from mapping.labels.label_resolver import LabelTable, load_label_table
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
        reference=ReferenceSettings(
            min_score=threshold or _REFERENCE_THRESHOLD,
            unknown_labels=arguments.unknown_labels,
            places_from_objects=bayes if weighs_objects is None else weighs_objects,
        ),
        layout=None if arguments.places in (None, FOUND, ONE) else _layout(arguments.places),
        find_places=(arguments.places or (FOUND if bayes else ONE)) == FOUND and arguments.floor,
        labels=load_label_table(Path(arguments.labels_map))
        if arguments.labels_map
        else LabelTable(),
        occupancy=arguments.floor,
        same_frame=arguments.same_frame,
        check_poses=not arguments.no_check,
        pictures=not arguments.no_pictures,
        surface=arguments.surface,
        encoder=_encoder(arguments),
    )


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


def add_mapping_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of mapping itself that `mapping_options` reads."""
    group = parser.add_argument_group("mapping")
    group.add_argument(
        "--labels-map",
        metavar="FILE",
        help="CSV file with lines label,category; the category - ignores the label",
    )
    group.add_argument(
        "--unknown-labels",
        choices=("provisional", "ignore"),
        default="provisional",
        help="labels without a category: give each a provisional one (default), or ignore them",
    )
    group.add_argument(
        "--places",
        metavar="FILE|found|one",
        help="areas of the places: GeoJSON polygons, JSON or CSV rectangles, or a map_server YAML "
        "file that names one of these; found: the rooms of the mapped floor; one: a single place "
        "around the viewed area (default: found; one in reference mode and with --no-floor)",
    )
    group.add_argument(
        "--mode",
        choices=MODES,
        default=MODES[0],
        help="mapping rules: bayes (default), or reference: the rules of the thesis",
    )
    group.add_argument(
        "--places-from-objects",
        action=argparse.BooleanOptionalAction,
        help="infer the kind of a place also from its objects and from how frequent each kind of "
        "room is (default: yes; no in reference mode)",
    )
    group.add_argument(
        "--floor",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="map free floor, walls and furniture from depth (default: yes)",
    )
    group.add_argument(
        "--surface",
        type=_voxel_side,
        default=DEFAULT_SURFACE,
        metavar="CM|none",
        help="side of the coloured voxels that keep the surface of the room beside the map, 1 to "
        "20 cm (default: 2.5, or that of the map); none: no surface",
    )
    group.add_argument(
        "--no-pictures",
        action="store_true",
        help="store no pictures of objects in the map's folder (those of people are never stored)",
    )
    group.add_argument(
        "--encoder",
        metavar="FILES",
        help="encoder of your own, by which any text is compared with the looks of things and "
        "views: image.onnx,text.onnx of CLIP, SigLIP or the like, or one file with both, and "
        "tokenizer.json beside it",
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
