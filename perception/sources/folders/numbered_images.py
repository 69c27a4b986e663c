"""Recordings with numbered images in two folders, and all poses in one file.

Trajectory log, as ICL-NUIM and Open3D's reconstruction system write it: trajectory.log repeats a
key line of three integers and the four rows of a camera -> world matrix. The first key is the
number of the image, or its place in the order of numbers.

HoloLens exporters: poses.txt has a camera -> world matrix of 16 numbers a line (row by row), in the
order of the images' numbers; K.txt has the 3x3 matrix of the colour camera.

Pose files, as ScanNet's exporter and many programs write them: pose/ has a file with the 4x4 matrix
for each image of colour and depth.

Replica, as NICE-SLAM renders it: results/ has frameN.jpg and depthN.png, traj.txt a matrix a line.

Images alone: the same two folders without a file of poses. The numbers of a pair of images are the
same, or they are the stamps [s] in their names, or the folders have as many images each.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.intrinsics import TEXT_NAMES, find_intrinsics
from perception.camera.poses import Pose, read_pose, read_pose_log, read_pose_rows
from perception.number_tables import in_seconds
from perception.sources.folders.image_files import (
    COLOUR_SUFFIXES,
    DEPTH_SUFFIXES,
    entry_of,
    files_in,
    images_by_number,
    pairs_by_number,
    tell_unpaired,
    with_poses,
)
from perception.sources.listing import (
    TOLERANCE,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    first_file,
    nearest_pairs,
    stamp_of_number,
    subfolder,
)

DEPTH_SCALE = 1000.0
REPLICA_SCALE = 6553.5
POSE_FOLDERS = ("pose", "poses")
ROW_FILES = ("poses.txt", "pose.txt", "traj_w_c.txt")  # the last: of Semantic-NeRF
COLOUR_FOLDERS = ("rgb", "color", "colour", "image", "images")
#: [s, or ms, us or ns] since 1970, in a name; or seconds and nanoseconds, as ROS has them
STAMP = re.compile(r"\d{9,10}\.\d+|(?<!\d)1\d{12}(?:\d{3}){0,2}(?!\d)")
ROS_STAMP = re.compile(r"(?<!\d)(1\d{9})[_-](\d{1,9})(?!\d)")
POSE_SUFFIXES = (".txt", ".csv", ".mat")


def _read_log(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder` by number, with the depth image and the pose of that number.

    Raises RecordingError where images have no pose.
    """
    log = _log_file(folder)
    if log is None:
        raise RecordingError(f"{folder} has no poses: trajectory.log is missing")
    colour, depth = _images(folder, "image", "color", "rgb")
    pairs = pairs_by_number(colour, depth, folder)
    poses = _poses_by_image(read_pose_log(log), list(pairs), log)
    return _listing(folder, ((*pair, poses[n], n) for n, pair in pairs.items()))


def _read_rows(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder` in number order, the n-th with the n-th depth image and pose.

    Where colour and depth share numbers, a frame may lack one of them. Raises RecordingError where
    there are not as many poses as frames.
    """
    file = first_file(folder, *ROW_FILES)
    if file is None:
        raise RecordingError(f"{folder} has no poses: poses.txt is missing")
    poses = read_pose_rows(file)
    with contextlib.suppress(RecordingError):
        pairs = pairs_by_stamp(subfolder(folder, *COLOUR_FOLDERS), subfolder(folder, "depth"))
        if len(pairs) == len(poses):
            entries = (entry_of(a, b, T, s) for (a, b, s), T in zip(pairs, poses, strict=True))
            return RecordingListing(tuple(entries), find_intrinsics(folder), DEPTH_SCALE)
    colour, depth = _images(folder, *COLOUR_FOLDERS)
    return _by_place(folder, colour, depth, poses)


def _by_place(
    folder: Path, colour: dict[int, Path], depth: dict[int, Path], poses: list[Pose]
) -> RecordingListing:
    pairs = list(zip(colour.values(), depth.values(), strict=False))
    apart = {d - c for c, d in zip(colour, depth, strict=False)}
    gaps = len(colour) != len(depth) or len(apart) > 1
    if gaps and 2 * len(colour.keys() & depth.keys()) > min(len(colour), len(depth)):
        pairs = list(pairs_by_number(colour, depth, folder).values())
    if len(pairs) != len(poses) or (gaps and len(pairs) < max(len(colour), len(depth))):
        raise RecordingError(
            f"{folder}: {len(colour)} colour images, {len(depth)} depth images and "
            f"{len(poses)} poses; there must be as many of each"
        )
    return _listing(
        folder, ((*pair, T, n) for n, (pair, T) in enumerate(zip(pairs, poses, strict=True)))
    )


def _read_replica(folder: Path, streams: Streams) -> RecordingListing:
    """As `_read_rows`, of images in one folder; the camera may lie beside the recording's folder.

    Raises RecordingError as it does.
    """
    if not _is_replica(folder):
        raise RecordingError(f"{folder} has no traj.txt beside results/")
    colour = images_by_number(folder / "results", prefix="frame")
    depth = images_by_number(folder / "results", (".png",), prefix="depth")
    listing = _by_place(folder, colour, depth, read_pose_rows(folder / "traj.txt"))
    camera = listing.camera or find_intrinsics(folder.resolve().parent)
    return replace(listing, camera=camera, depth_scale=REPLICA_SCALE)


def _read_pose_files(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder`, with poses by name; raises RecordingError for one not rigid."""
    alone = _read_alone(folder, streams)
    poses = subfolder(folder, *POSE_FOLDERS)
    files = {p.stem: p for p in files_in(poses) if p.suffix.lower() in POSE_SUFFIXES}
    if set(files).isdisjoint(entry.id for entry in alone.entries):
        numbers = images_by_number(poses, POSE_SUFFIXES)
        ids = images_by_number(subfolder(folder, *COLOUR_FOLDERS))
        files = {path.stem: numbers[number] for number, path in ids.items() if number in numbers}

    def pose_of(entry: FrameEntry) -> Pose | None:
        return read_pose(files[entry.id]) if entry.id in files else None

    entries = with_poses(alone.entries, pose_of)
    missing = f"{folder}: no image has a finite pose of its name in {poses.name}/"
    return replace(alone, entries=entries, no_poses="", no_pose_found=missing)


def _read_alone(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder`, in order, without poses.

    Raises RecordingError where it is not clear which are of one frame.
    """
    colour = subfolder(folder, *COLOUR_FOLDERS)
    depth = subfolder(folder, "depth")
    pairs = pairs_by_stamp(colour, depth) or _by_number(colour, depth)
    return RecordingListing(
        tuple(entry_of(a, b, np.eye(4), stamp) for a, b, stamp in pairs),
        find_intrinsics(folder),
        DEPTH_SCALE,
        no_poses=f"{folder} has no poses: no groundtruth.txt, trajectory.log, poses.txt, "
        f"transforms.json or pose/ with text files{_others(folder)}",
    )


def _others(folder: Path) -> str:
    """Files of a folder that may have poses, for a message."""
    found = [p.name for p in files_in(folder) if p.suffix.lower() in POSE_SUFFIXES]
    found = [name for name in found if name not in TEXT_NAMES]
    return f"; --poses {found[0]} reads that file, where it has some" if found else ""


def pairs_by_stamp(
    colour: Path, depth: Path, stamp: re.Pattern[str] = STAMP
) -> list[tuple[Path, Path, float]]:
    """Pairs of images by the `stamp` in their names; empty where a name has none."""
    found = []
    for folder, suffixes in ((colour, COLOUR_SUFFIXES), (depth, DEPTH_SUFFIXES)):
        paths = [path for path in files_in(folder) if path.suffix.lower() in suffixes]
        stamps = [stamp.search(ROS_STAMP.sub(_with_point, path.stem)) for path in paths]
        if not paths or not all(stamps):
            return []
        numbers = np.array([float(one[0]) for one in stamps if one])
        found.append((paths, in_seconds(numbers, folder)))
    (colours, a), (depths, b) = found
    pairs = sorted(nearest_pairs(a, b, TOLERANCE), key=lambda pair: float(a[pair[0]]))
    if not pairs:
        raise RecordingError(f"{colour} and {depth}: no stamps in names lie within {TOLERANCE} s")
    tell_unpaired(colour.parent, len(a), len(b), len(pairs), f"within {TOLERANCE} s")
    return [(colours[i], depths[j], float(a[i])) for i, j in pairs]


def _with_point(found: re.Match[str]) -> str:
    return f"{found[1]}.{int(found[2]):09d}"


def _by_number(colour: Path, depth: Path) -> list[tuple[Path, Path, float]]:
    """Pairs of images by their numbers, else by their order where there are as many of both."""
    a, b = images_by_number(colour), images_by_number(depth, DEPTH_SUFFIXES)
    if 2 * len(a.keys() & b.keys()) >= min(len(a), len(b)):
        both = pairs_by_number(a, b, colour.parent)
        return [(*pair, stamp_of_number(number)) for number, pair in both.items()]
    if len(a) != len(b):
        raise RecordingError(
            f"{colour} has {len(a)} images, {depth} {len(b)}, and their numbers differ; "
            "names with the same number, or with stamps in seconds, would work"
        )
    pairs = zip(a.values(), b.values(), strict=True)
    return [(x, y, stamp_of_number(place)) for place, (x, y) in enumerate(pairs)]


def _has_images(folder: Path) -> bool:
    return (folder / "depth").is_dir() and any((folder / n).is_dir() for n in COLOUR_FOLDERS)


def _has_pose_files(folder: Path) -> bool:
    poses = next((folder / n for n in POSE_FOLDERS if (folder / n).is_dir()), None)
    return (
        poses is not None
        and _has_images(folder)
        and any(path.suffix.lower() in POSE_SUFFIXES for path in poses.iterdir())
    )


def _is_replica(folder: Path) -> bool:
    return (folder / "results").is_dir() and (folder / "traj.txt").is_file()


def _images(folder: Path, *names: str) -> tuple[dict[int, Path], dict[int, Path]]:
    """Colour images of the first of the named folders, and depth images, by number."""
    colour = images_by_number(subfolder(folder, *names))
    return colour, images_by_number(subfolder(folder, "depth"), DEPTH_SUFFIXES)


def _listing(folder: Path, images: Iterable[tuple[Path, Path, Pose, int]]) -> RecordingListing:
    """Listing of colour images, depth images, poses and numbers."""
    entries = tuple(entry_of(a, b, T, stamp_of_number(number)) for a, b, T, number in images)
    return RecordingListing(entries, find_intrinsics(folder), DEPTH_SCALE)


def _has_rows(folder: Path) -> bool:
    return first_file(folder, *ROW_FILES) is not None and (folder / "depth").is_dir()


def _log_file(folder: Path) -> Path | None:
    others = sorted(path.name for path in folder.glob("*trajectory*.log"))
    return first_file(folder, "trajectory.log", "scene/trajectory.log", *others)


def _poses_by_image(poses: dict[int, Pose], numbers: list[int], log: Path) -> dict[int, Pose]:
    """Poses by image number; by place in their order where the keys count from zero."""
    if set(numbers) <= set(poses):
        return poses
    if len(poses) == len(numbers) and sorted(poses) == list(range(len(poses))):
        return {number: poses[place] for place, number in enumerate(numbers)}
    missing = [number for number in numbers if number not in poses]
    raise RecordingError(
        f"{log}: {len(poses)} poses for {len(numbers)} images; no pose for image {missing[0]}"
    )


TRAJECTORY_LOG = Format(
    "trajectory-log",
    "trajectory.log, image|color|rgb/, depth/ and intrinsics.json",
    lambda folder: _log_file(folder) is not None,
    _read_log,
)
HOLOLENS = Format("hololens", "images|rgb/, depth/, poses.txt and K.txt", _has_rows, _read_rows)
POSE_FILES = Format(
    "pose-files", "rgb|color|image|images/, depth/ and pose/", _has_pose_files, _read_pose_files
)
REPLICA = Format("replica", "results/, traj.txt and cam_params.json", _is_replica, _read_replica)
IMAGES = Format(
    "images", "rgb|color|image|images/, depth/ and intrinsics.json", _has_images, _read_alone
)
