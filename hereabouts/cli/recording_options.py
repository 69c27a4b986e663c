"""Options of recordings on the command line: arguments, and `RecordingOptions` made of them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hereabouts.cli.arguments import declare, options_of, positive, whole
from hereabouts.cli.console import progress
from kg.model.errors import HistoryError

if TYPE_CHECKING:
    from perception.sources.listing import RecordingListing
    from perception.sources.recording import FolderRecording
    from perception.sources.recording_options import RecordingOptions

ESTIMATE: Final = "estimate"  # value of `--poses` beside files


_SOURCE = """
--format FORMAT        auto, tum, 7scenes, trajectory-log, hololens, stray-scanner, record3d,
                       nerfstudio, polycam, images, bag, or the format of an extension (default:
                       auto)
--name NAME            name of the recording in the map (default: its folder)
--pose-convention      convention of the poses; opengl: camera to world, the camera looks along -z
                       with y up; ros: body to world, the camera looks along x with z up (default:
                       camera-to-world)
--no-check -> check    use depth scale and poses even if the depth images contradict them
--registered           depth is registered to colour, whatever the recording says of its own camera
--bgr                  exchange red and blue of the images
--up AXIS              up axis of the world: x, y, z, -x, -y, -z or a vector A,B,C (default: as the
                       recording says, else estimated)
"""
_STREAMS = """
--intrinsics FILE      file of intrinsics: .json or .txt
--depth-scale N        depth units per metre, e.g. 1000
--color-topic TOPIC -> colour
                       colour images of a bag (default: guessed; see `info`)
--depth-topic TOPIC -> depth
                       depth images of a bag (default: guessed; see `info`)
--info-topic TOPIC -> camera
                       CameraInfo of the colour images (default: guessed; see `info`)
--pose-topic TOPIC -> pose
                       poses of a bag instead of tf: odometry, poses or a path (default: guessed;
                       see `info`)
--pose-frame FRAME     frame whose poses that topic gives (default: the one it names, else the
                       camera's)
--camera-frame FRAME   frame of the colour camera (default: that in the headers of its images)
--camera-in FRAME=X,Y,Z,ROLL,PITCH,YAW|URDF
                       where the colour camera sits, if tf does not say it: pose in a frame of its
                       body (x ahead, z up) in metres and radians, or a URDF file; in folders on the
                       body whose poses they have
--map-frame FRAME      frame of a bag's poses (default: map, world or odom, else the root of tf)
--tolerance SECONDS    maximum time between colour and depth of one frame of a bag (default: 0.02)
"""
_FRAMES = """
--poses FILE|estimate  trajectory in TUM format that replaces the recording's poses; objects and
                       floor that were mapped from the recording move with it; estimate: poses from
                       the images, also where the recording has some (default: the recording's own,
                       else estimated)
--disparity BASELINE   depth images are disparities of two cameras, so many metres apart;
                       --depth-scale is their units per pixel
--every N              read every N-th frame, the first too
--keyframes            read only frames whose camera has moved by 0.1 m or turned by 5 degrees since
                       the last one read
--limit N              read N frames at most
--from SECONDS -> start
                       skip frames before this time after the first frame
--to SECONDS -> stop   skip frames after this time after the first frame
--started TIME -> start_time
                       time of recording in ISO 8601, for stamps that count from zero (default: now)
--transform FILE       JSON file of world-to-map transforms
--sequence NAME        name of a transform in that file
"""
_WORLD = """
--align                estimate the pose of a new recording in the map by its floor and objects
--same-frame           the recording has the same world frame as the map's other recordings
"""


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `recording_options` reads, `--align` and `--same-frame`."""
    group = parser.add_argument_group("recording")
    _add_source(group)
    declare(
        group,
        _FRAMES,
        disparity=positive,
        every={"type": whole, "default": 1},
        limit=whole,
        start=float,
        stop=float,
        start_time=_moment,
    )
    declare(group.add_mutually_exclusive_group(), _WORLD)


def add_source_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that `source_options` reads, and `--same-frame`."""
    group = parser.add_argument_group("source")
    _add_source(group)
    same = "a folder new to the map has the same world frame as the map's other recordings"
    declare(group, f"--same-frame  {same}")


def _add_source(group: argparse._ArgumentGroup) -> None:
    conventions = ("camera-to-world", "world-to-camera", "opengl", "ros")
    declare(
        group,
        _SOURCE,
        format={"default": "auto"},
        pose_convention={"choices": conventions, "default": conventions[0]},
        check={"action": "store_false"},
    )
    add_stream_arguments(group)


def add_stream_arguments(group: argparse._ArgumentGroup) -> None:
    """Declare the arguments of topics and of the camera, which `source_options` reads."""
    declare(group, _STREAMS, depth_scale=positive, tolerance={"type": positive, "default": 0.02})


def source_options(arguments: argparse.Namespace, **others: Any) -> RecordingOptions:
    """Options of a source of frames, as far as the command has them, and `others`.

    Raises RecordingError for unreadable intrinsics.
    """
    from perception.camera.intrinsics import load_intrinsics
    from perception.sources.listing import Streams
    from perception.sources.recording_options import RecordingOptions

    file = arguments.intrinsics
    read = {"intrinsics": None if file is None else load_intrinsics(Path(file)), "poses": None}
    streams = options_of(Streams, arguments)
    return options_of(RecordingOptions, arguments, **{**read, "streams": streams, **others})


def recording_options(arguments: argparse.Namespace, path: str) -> RecordingOptions:
    """Options of the recording at `path`; raises HereaboutsError for unreadable files."""
    from mapping.alignment.recording_fit import load_transform
    from perception.sources.recording_options import Selection

    if arguments.sequence is not None and arguments.transform is None:
        arguments.usage_error("--sequence needs --transform: it names a transform in that file")
    if arguments.transform is not None and arguments.align:
        arguments.usage_error("--transform gives the pose that --align would estimate")
    T_map_world, poses = None, arguments.poses
    if arguments.transform is not None:
        sequence = arguments.sequence or Path(path).resolve().name
        T_map_world = load_transform(Path(arguments.transform), sequence)
    return source_options(
        arguments,
        T_map_world=T_map_world,
        poses=None if poses in (None, ESTIMATE) else Path(poses),
        estimate_poses=True if poses == ESTIMATE else None,
        selection=options_of(Selection, arguments),
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


def _moment(text: str) -> float:
    """Seconds since 1970 of ISO 8601 text."""
    from kg.history.timestamps import moment

    try:
        return moment(text)
    except HistoryError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
