"""Options of recordings on the command line: arguments, and `RecordingOptions` made of them."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hereabouts.cli.arguments import positive, whole
from hereabouts.cli.console import progress
from kg.model.errors import HistoryError

if TYPE_CHECKING:
    from perception.sources.listing import RecordingListing
    from perception.sources.recording import FolderRecording
    from perception.sources.recording_options import RecordingOptions

ESTIMATE: Final = "estimate"  # value of `--poses` beside files


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `recording_options` reads, `--align` and `--same-frame`."""
    parser.set_defaults(usage_error=parser.error)
    group = parser.add_argument_group("recording")
    _add_source_arguments(group)
    add_stream_arguments(group)
    group.add_argument(
        "--poses",
        metavar="FILE|estimate",
        help="trajectory in TUM format that replaces the recording's poses; objects and floor "
        "that were mapped from the recording move with it; estimate: poses from the images, also "
        "where the recording has some (default: the recording's own, else estimated)",
    )
    group.add_argument(
        "--every",
        type=whole,
        default=1,
        metavar="N",
        help="read every N-th frame, the first too",
    )
    group.add_argument(
        "--keyframes",
        action="store_true",
        help="read only frames whose camera has moved by 0.1 m or turned by 5 degrees since the "
        "last one read",
    )
    group.add_argument("--limit", type=whole, metavar="N", help="read N frames at most")
    group.add_argument(
        "--from",
        dest="start",
        type=float,
        metavar="SECONDS",
        help="skip frames before this time after the first frame",
    )
    group.add_argument(
        "--to",
        dest="stop",
        type=float,
        metavar="SECONDS",
        help="skip frames after this time after the first frame",
    )
    group.add_argument(
        "--started",
        type=_moment,
        metavar="TIME",
        help="time of recording in ISO 8601, for stamps that count from zero (default: now)",
    )
    group.add_argument("--transform", metavar="FILE", help="JSON file of world-to-map transforms")
    group.add_argument("--sequence", metavar="NAME", help="name of a transform in that file")
    world = group.add_mutually_exclusive_group()
    world.add_argument(
        "--align",
        action="store_true",
        help="estimate the pose of a new recording in the map by its floor and objects",
    )
    world.add_argument(
        "--same-frame",
        action="store_true",
        help="the recording has the same world frame as the map's other recordings",
    )


def add_source_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `source_options` reads, and `--same-frame`."""
    parser.set_defaults(usage_error=parser.error)
    group = parser.add_argument_group("source")
    _add_source_arguments(group)
    add_stream_arguments(group)
    group.add_argument(
        "--same-frame",
        action="store_true",
        help="a folder new to the map has the same world frame as the map's other recordings",
    )


def recording_options(arguments: argparse.Namespace, path: str) -> RecordingOptions:
    """Options of the recording at `path`; raises HereaboutsError for unreadable files."""
    from mapping.alignment.recording_fit import load_transform
    from perception.sources.recording_options import Selection

    if arguments.sequence is not None and arguments.transform is None:
        arguments.usage_error("--sequence needs --transform: it names a transform in that file")
    if arguments.transform is not None and arguments.align:
        arguments.usage_error("--transform gives the pose that --align would estimate")
    T_map_world = None
    if arguments.transform is not None:
        sequence = arguments.sequence or Path(path).resolve().name
        T_map_world = load_transform(Path(arguments.transform), sequence)
    return replace(
        source_options(arguments),
        T_map_world=T_map_world,
        poses=Path(arguments.poses) if arguments.poses not in (None, ESTIMATE) else None,
        estimate_poses=True if arguments.poses == ESTIMATE else None,
        start_time=arguments.started,
        selection=Selection(
            every=arguments.every,
            limit=arguments.limit,
            start=arguments.start,
            stop=arguments.stop,
            keyframes=arguments.keyframes,
        ),
    )


def opened_recording(
    path: str, options: RecordingOptions, listing: RecordingListing | None = None
) -> FolderRecording:
    """The recording at `path`, with a progress bar while its poses are estimated."""
    from perception.sources.recording import open_recording

    with progress() as bar:
        task = bar.add_task("estimating poses", total=None, visible=False, status="")

        def on_estimated(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, visible=True)

        return open_recording(path, options, listing=listing, on_estimated=on_estimated)


def source_options(arguments: argparse.Namespace) -> RecordingOptions:
    """Options of a source of frames, a folder or topics; raises RecordingError."""
    return replace(
        stream_options(arguments),
        format=arguments.format,
        name=arguments.name,
        up=arguments.up,
        pose_convention=arguments.pose_convention,
        check=not arguments.no_check,
        registered=arguments.registered,
    )


def stream_options(arguments: argparse.Namespace) -> RecordingOptions:
    """Options of topics and of the camera; raises RecordingError for unreadable intrinsics."""
    from perception.camera.intrinsics import load_intrinsics
    from perception.sources.listing import Streams
    from perception.sources.recording_options import RecordingOptions

    return RecordingOptions(
        intrinsics=load_intrinsics(Path(arguments.intrinsics)) if arguments.intrinsics else None,
        depth_scale=arguments.depth_scale,
        streams=Streams(
            colour=arguments.color_topic,
            depth=arguments.depth_topic,
            camera=arguments.info_topic,
            pose=arguments.pose_topic,
            pose_frame=arguments.pose_frame,
            camera_frame=arguments.camera_frame,
            camera_in=arguments.camera_in,
            map_frame=arguments.map_frame,
            tolerance=arguments.tolerance,
        ),
    )


def add_stream_arguments(group: argparse._ArgumentGroup) -> None:
    """Declare the arguments that `stream_options` reads."""
    group.add_argument("--intrinsics", metavar="FILE", help="file of intrinsics: .json or .txt")
    group.add_argument(
        "--depth-scale", type=positive, metavar="N", help="depth units per metre, e.g. 1000"
    )
    for option, holds in (
        ("--color-topic", "colour images of a bag"),
        ("--depth-topic", "depth images of a bag"),
        ("--info-topic", "CameraInfo of the colour images"),
        ("--pose-topic", "poses of a bag instead of tf: odometry, poses or a path"),
    ):
        group.add_argument(option, metavar="TOPIC", help=f"{holds} (default: guessed; see `info`)")
    group.add_argument(
        "--pose-frame",
        metavar="FRAME",
        help="frame whose poses that topic gives (default: the one it names, else the camera's)",
    )
    group.add_argument(
        "--camera-frame",
        metavar="FRAME",
        help="frame of the colour camera (default: that in the headers of its images)",
    )
    group.add_argument(
        "--camera-in",
        metavar="FRAME=X,Y,Z,ROLL,PITCH,YAW|URDF",
        help="where the colour camera sits, if tf does not say it: pose in a frame of its body (x "
        "ahead, z up) in metres and radians, or a URDF file",
    )
    group.add_argument(
        "--map-frame",
        metavar="FRAME",
        help="frame of a bag's poses (default: map, world or odom, else the root of tf)",
    )
    group.add_argument(
        "--tolerance",
        type=positive,
        default=0.02,
        metavar="SECONDS",
        help="maximum time between colour and depth of one frame of a bag (default: 0.02)",
    )


def _add_source_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--format",
        default="auto",
        help="auto, tum, 7scenes, trajectory-log, hololens, stray-scanner, record3d, nerfstudio, "
        "polycam, images, bag, or the "
        "format of an extension (default: auto)",
    )
    group.add_argument("--name", help="name of the recording in the map (default: its folder)")
    group.add_argument(
        "--pose-convention",
        choices=("camera-to-world", "world-to-camera", "opengl", "ros"),
        default="camera-to-world",
        help="convention of the poses; opengl: camera to world, the camera looks along -z with y "
        "up; ros: body to world, the camera looks along x with z up (default: camera-to-world)",
    )
    group.add_argument(
        "--no-check",
        action="store_true",
        help="use depth scale and poses even if the depth images contradict them",
    )
    group.add_argument(
        "--registered",
        action="store_true",
        help="depth is registered to colour, whatever the recording says of its own camera",
    )
    group.add_argument(
        "--up",
        metavar="AXIS",
        help="up axis of the world: x, y, z, -x, -y, -z or a vector A,B,C (default: as the "
        "recording says, else estimated)",
    )


def _moment(text: str) -> float:
    """Seconds since 1970 of ISO 8601 text."""
    from kg.history.timestamps import moment

    try:
        return moment(text)
    except HistoryError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
