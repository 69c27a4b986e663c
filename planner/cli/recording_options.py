"""Options that say which recording, which networks and which places: `map`, `live`, `evaluate`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from kg.errors import HistoryError
from planner.cli.arguments import add_device, positive, whole

if TYPE_CHECKING:
    from mapping.mapper import Mode

#: values of `--mode`, the default first
MODES: Final[tuple[Mode, ...]] = ("bayes", "reference")


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `open_inputs` reads."""
    parser.set_defaults(usage_error=parser.error)
    add_camera_options(parser.add_argument_group("recording"))
    _add_network_options(parser.add_argument_group("networks"))
    _add_mapping_options(parser.add_argument_group("mapping"))


def add_live_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `open_mapping_inputs` reads, and those of a source of frames."""
    parser.set_defaults(
        usage_error=parser.error, every=1, keyframes=False, limit=None, started=None,
        start=None, stop=None,
        poses=None, transform=None, sequence=None, align=False,
    )  # fmt: skip
    source = parser.add_argument_group("source")
    _add_source_options(source)
    add_stream_options(source)
    source.add_argument(
        "--same-frame",
        action="store_true",
        help="the world of a folder that is new to the map is that of the map's other recordings",
    )
    _add_network_options(parser.add_argument_group("networks"))
    _add_mapping_options(parser.add_argument_group("mapping"))


def add_intrinsics_options(camera: argparse._ArgumentGroup) -> None:
    """Declare the options that `given_intrinsics` and `open_stream` read, but for the streams."""
    camera.add_argument("--intrinsics", metavar="FILE", help="intrinsics.json, .txt or K.txt")
    camera.add_argument(
        "--depth-scale", type=positive, metavar="N", help="depth units in a metre, e.g. 1000"
    )


def _add_source_options(camera: argparse._ArgumentGroup) -> None:
    camera.add_argument(
        "--format",
        default="auto",
        help="auto, tum, 7scenes, trajectory-log, hololens, stray-scanner, bag, or the format of "
        "an extension (default: auto)",
    )
    camera.add_argument("--name", help="name of the recording in the map (default: its folder)")
    add_intrinsics_options(camera)
    camera.add_argument(
        "--pose-convention",
        choices=("camera-to-world", "world-to-camera", "opengl", "ros"),
        default="camera-to-world",
        help="what the poses are; opengl: camera to world, of a camera with y up that looks along "
        "-z; ros: body to world, of a camera that looks along x with z up (default: "
        "camera-to-world)",
    )
    camera.add_argument(
        "--no-check",
        action="store_true",
        help="take depth scale and poses as they are, though depth contradicts them",
    )
    camera.add_argument(
        "--up",
        metavar="AXIS",
        help="the world's up: x, y, z, -x, -y, -z or a vector A,B,C (default: read, else found)",
    )


def add_camera_options(camera: argparse._ArgumentGroup) -> None:
    """Declare the options that `open_given_recording` reads."""
    _add_source_options(camera)
    camera.add_argument(
        "--poses",
        metavar="FILE",
        help="trajectory in TUM format instead of the recording's own poses; what a map has of the "
        "recording already moves with it",
    )
    _add_frame_options(camera)
    add_stream_options(camera)
    camera.add_argument("--transform", metavar="FILE", help="JSON of world-to-map transforms")
    camera.add_argument("--sequence", metavar="NAME", help="which transform of that file")
    world = camera.add_mutually_exclusive_group()
    world.add_argument(
        "--align",
        action="store_true",
        help="search how a recording new to the map sits in it, by floor and objects",
    )
    world.add_argument(
        "--same-frame",
        action="store_true",
        help="the recording's world is that of the map's other recordings",
    )


def _add_frame_options(camera: argparse._ArgumentGroup) -> None:
    camera.add_argument(
        "--every", type=whole, default=1, metavar="N", help="read the first frame and each N-th"
    )
    camera.add_argument(
        "--keyframes",
        action="store_true",
        help="read only frames whose camera has moved by 0.1 m or turned by 5 degrees since the "
        "last one read",
    )
    camera.add_argument("--limit", type=whole, metavar="N", help="read N frames at most")
    camera.add_argument(
        "--started",
        type=_moment,
        metavar="TIME",
        help="when it was recorded, ISO 8601, if its stamps count from zero (default: now)",
    )
    camera.add_argument(
        "--from",
        dest="start",
        type=float,
        metavar="SECONDS",
        help="leave out what comes sooner after the recording's first frame",
    )
    camera.add_argument(
        "--to",
        dest="stop",
        type=float,
        metavar="SECONDS",
        help="leave out what comes later after the recording's first frame",
    )


def _moment(text: str) -> float:
    """Seconds since 1970 of ISO 8601 text."""
    from kg.history.timestamps import moment

    try:
        return moment(text)
    except HistoryError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_stream_options(camera: argparse._ArgumentGroup) -> None:
    """Declare the options that `given_streams` reads."""
    for option, what in (
        ("--color-topic", "colour images of a bag"),
        ("--depth-topic", "depth images of a bag"),
        ("--info-topic", "CameraInfo of the colour images"),
        ("--pose-topic", "poses of a bag instead of tf: odometry, or poses of the colour camera"),
    ):
        camera.add_argument(option, metavar="TOPIC", help=f"{what} (default: guessed; see `info`)")
    camera.add_argument(
        "--map-frame",
        metavar="FRAME",
        help="frame of a bag's poses (default: map, world or odom, else the root of tf)",
    )
    camera.add_argument(
        "--tolerance",
        type=positive,
        default=0.02,
        metavar="SECONDS",
        help="between stamps of a bag's colour and depth that are one frame (default: 0.02)",
    )


def _add_network_options(networks: argparse._ArgumentGroup) -> None:
    networks.add_argument(
        "--detector",
        default="default",
        metavar="NAME|FILE",
        help="object detector by name, also that of an extension, or a JSON file of recorded "
        "detections, here or in the recording's folder; best: the best one that can be fetched, "
        "fetched if it is not here (default: the bundled ones; see `hereabouts models list`)",
    )
    networks.add_argument(
        "--second-detector",
        metavar="NAME|FILE",
        help="another detector, which looks at new points of view",
    )
    networks.add_argument(
        "--threshold",
        type=positive,
        help="least detector score (default: 0.2, which are weighed; reference mode: 0.4)",
    )
    add_device(networks)
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


def _add_mapping_options(places: argparse._ArgumentGroup) -> None:
    places.add_argument(
        "--places",
        metavar="FILE|found|one",
        help="areas of the places: GeoJSON polygons, JSON or CSV rectangles, or a map_server YAML "
        "file that names one of these; found: the rooms of the mapped floor; one: a place around "
        "what is seen (default: found; one in reference mode and without floor)",
    )
    places.add_argument(
        "--mode",
        choices=MODES,
        default=MODES[0],
        help="mapping rules: bayes (default), or the thesis' own",
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
        action=argparse.BooleanOptionalAction,
        help="objects, and how frequent kinds of rooms are, count in what a place is believed to "
        "be, beside the scene classifier (default: yes, not in reference mode)",
    )
    places.add_argument(
        "--floor",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="map free floor, walls and furniture from depth (default: yes)",
    )
    places.add_argument(
        "--no-pictures",
        action="store_true",
        help="keep no small picture of each object in the map's folder (of people none is kept)",
    )
