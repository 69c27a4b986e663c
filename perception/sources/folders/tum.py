"""Recordings in the format of the TUM RGB-D benchmark: lists of time-stamped files.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (IROS 2012), and its page on
file formats: rgb.txt and depth.txt (`stamp file`), groundtruth.txt (`stamp tx ty tz qx qy qz qw`,
pose of the colour camera), associations.txt (`stamp file stamp file`), 16-bit depth with 5000 units
a metre. ICL-NUIM has depth first in associations.txt, and *.gt.freiburg. Without lists, images have
their stamps as names.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.intrinsics import Intrinsics, find_intrinsics
from perception.camera.poses import read_trajectory
from perception.number_tables import floats, in_seconds, rows
from perception.sources.folders.image_files import entry_of, tell_unpaired, with_poses
from perception.sources.folders.numbered_images import COLOUR_FOLDERS, pairs_by_stamp
from perception.sources.listing import (
    TOLERANCE,
    Format,
    RecordingListing,
    Streams,
    first_file,
    nearest_pairs,
    subfolder,
)

DEPTH_FACTOR = 5000.0
#: the second: already at colour's stamps; the third: of Kimera
POSES = ("groundtruth.txt", "groundtruth_at_rgb.txt", "traj_vio.csv")
#: files of poses that programs leave in a folder of the benchmark's lists
OTHER_POSES = (
    "groundtruth.csv",
    "CameraTrajectory.txt",
    "trajectory.txt",
    "KeyFrameTrajectory.txt",
)

#: The benchmark's published colour calibrations, by the camera's name in the folder's name.
CALIBRATIONS = {
    "fr1": Intrinsics(
        517.306408, 516.469215, 318.643040, 255.313989, 640, 480,
        (0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
    ),
    "fr2": Intrinsics(
        520.908620, 521.007327, 325.141442, 249.701764, 640, 480,
        (0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
    ),
    "fr3": Intrinsics(535.4, 539.2, 320.1, 247.6, 640, 480),
}  # fmt: skip

_Pair = tuple[float, str, str]  # colour stamp, colour file, depth file


def matches(folder: Path) -> bool:
    """Whether `folder` holds lists or depth/ with poses of the benchmark.

    rgb.txt alone is none of its lists: other programs name lists of colours so.
    """
    beside = any((folder / name).exists() for name in ("depth.txt", "rgb", "depth", *POSES))
    lists = (folder / "associations.txt").is_file() or ((folder / "rgb.txt").is_file() and beside)
    return lists or ((folder / "depth").is_dir() and _poses(folder) is not None)


def _poses(folder: Path) -> Path | None:
    others = sorted(path.name for path in folder.glob("*.gt.freiburg"))
    return first_file(folder, *POSES, *others)


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All colour images that have a depth image; the others are skipped with a warning.

    Raises RecordingError where lists are
    missing, lists or poses malformed, or nothing fits together.
    """
    entries = tuple(
        entry_of(folder / colour, folder / depth, np.eye(4), stamp)
        for stamp, colour, depth in sorted(_pairs(folder))
    )
    poses = _poses(folder) or first_file(folder, *OTHER_POSES)
    if poses is None:
        missing = f"{folder} has no poses: {' or '.join(POSES[:2])} is missing"
        return RecordingListing(entries, _camera(folder), DEPTH_FACTOR, no_poses=missing)
    trajectory = read_trajectory(poses)
    missing = (
        f"{folder}: none of the {len(entries)} images has a pose in {poses.name} "
        f"within {TOLERANCE} s (poses: {trajectory.reach})"
    )
    entries = with_poses(entries, lambda entry: trajectory.at(entry.stamp, TOLERANCE))
    scale = MILLIMETRES if poses.name == POSES[2] else DEPTH_FACTOR
    return RecordingListing(entries, _camera(folder), scale, no_pose_found=missing)


def _camera(folder: Path) -> Intrinsics | None:
    found = find_intrinsics(folder)
    if found is not None:
        return found
    name = folder.resolve().name.lower().replace("freiburg", "fr")
    return next((c for key, c in CALIBRATIONS.items() if key in re.split(r"[_-]", name)), None)


def _pairs(folder: Path) -> list[_Pair]:
    associations = folder / "associations.txt"
    if associations.is_file():
        rows = _checked(associations, 4, "stamp file stamp file")
        swapped = all("depth" in a and "depth" not in b for _, (_, a, _, b, *_) in rows)
        colour, depth = (2, 0) if swapped else (0, 2)
        stamps = [floats(words[colour : colour + 1], where)[0] for where, words in rows]
        return [
            (float(stamp), _found(folder, words[colour + 1]), _found(folder, words[depth + 1]))
            for stamp, (_, words) in zip(
                in_seconds(np.array(stamps), associations), rows, strict=True
            )
        ]
    if not (folder / "rgb.txt").is_file():
        depths = subfolder(folder, "aligned_depth", "depth")  # both in OpenLORIS-Scene
        images = pairs_by_stamp(subfolder(folder, *COLOUR_FOLDERS), depths)
        if not images:
            raise RecordingError(
                f"{folder} has no rgb.txt and depth.txt, and its images have no stamps as names"
            )
        return [(s, str(a.relative_to(folder)), str(b.relative_to(folder))) for a, b, s in images]
    return _associate(_list(folder / "rgb.txt"), _list(folder / "depth.txt"), folder)


def _list(path: Path) -> list[tuple[float, str]]:
    table = _checked(path, 2, "stamp file")
    stamps = in_seconds(np.array([floats(words[:1], where)[0] for where, words in table]), path)
    return [
        (float(stamp), _file(path.parent, words[1:], path.stem))
        for stamp, (_, words) in zip(stamps, table, strict=True)
    ]


def _file(folder: Path, words: list[str], usual: str) -> str:
    """The file named by the first word, or by all, where its name has spaces."""
    whole = " ".join(words)
    known = len(words) > 1 and (folder / whole).is_file()
    return whole if known else _found(folder, words[0], usual)


def _found(folder: Path, name: str, usual: str = "") -> str:
    """The name of a file that is there: of another system or machine, or without its folder."""
    parts = name.replace("\\", "/").split("/")
    tried = (name, "/".join(parts[-2:]), "/".join([usual, parts[-1]]).lstrip("/"))
    return next((one for one in tried if (folder / one).is_file()), name)


def _checked(path: Path, columns: int, meaning: str) -> list[tuple[str, list[str]]]:
    table = list(rows(path))
    for where, words in table:
        if len(words) < columns:
            raise RecordingError(f"{where}: expected {meaning}, got {' '.join(words)!r}")
    if not table:
        raise RecordingError(f"{path} lists no images")
    return table


def _associate(
    colour: list[tuple[float, str]], depth: list[tuple[float, str]], folder: Path
) -> list[_Pair]:
    """Pairs of nearest stamps within TOLERANCE, nearest pair first, each image used once."""
    of_colour, of_depth = (np.array([s for s, _ in images]) for images in (colour, depth))
    near = nearest_pairs(of_colour, of_depth, TOLERANCE)
    pairs = [(*colour[i], depth[j][1]) for i, j in near]
    if not pairs:
        raise RecordingError(f"{folder}: no rgb and depth stamps lie within {TOLERANCE} s")
    tell_unpaired(folder, len(colour), len(depth), len(pairs), f"within {TOLERANCE} s")
    return pairs


FORMAT = Format("tum", "rgb.txt and depth.txt, or associations.txt; groundtruth.txt", matches, read)
