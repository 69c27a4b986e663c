"""Recordings with a trajectory log, as ICL-NUIM and Open3D's reconstruction system write them.

trajectory.log repeats a key line of three integers and the four rows of a camera -> world matrix;
the first key is the number of the image, or its place in the row.
"""

from __future__ import annotations

from pathlib import Path

from kg.errors import RecordingError
from perception.camera.intrinsics import find_intrinsics
from perception.camera.poses import Pose, read_pose_log
from perception.recordings.image_files import ImageFile, images_by_number
from perception.recordings.listing import (
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    stamp_of_number,
    subfolder,
)

DEPTH_SCALE = 1000.0


def matches(folder: Path) -> bool:
    """Whether `folder` holds a trajectory log."""
    return _log_file(folder) is not None


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder` by number, with the pose of that number.

    Raises RecordingError where colour, depth and poses do not match one to one.
    """
    log = _log_file(folder)
    if log is None:
        raise RecordingError(f"{folder} has no poses: trajectory.log is missing")
    colour = images_by_number(subfolder(folder, "image", "color", "rgb"))
    depth = images_by_number(subfolder(folder, "depth"), (".png",))
    poses = _poses_by_image(read_pose_log(log), list(colour), log)
    for number, path in colour.items():
        if number not in depth:
            raise RecordingError(f"{path} has no depth image numbered {number}")
    entries = tuple(
        FrameEntry(
            path.stem,
            ImageFile(path),
            ImageFile(depth[number]),
            poses[number],
            stamp_of_number(number),
        )
        for number, path in colour.items()
    )
    return RecordingListing(entries, find_intrinsics(folder), DEPTH_SCALE)


def _log_file(folder: Path) -> Path | None:
    found = [folder / "trajectory.log", *sorted(folder.glob("*trajectory*.log"))]
    return next((path for path in found if path.is_file()), None)


def _poses_by_image(poses: dict[int, Pose], numbers: list[int], log: Path) -> dict[int, Pose]:
    """Poses keyed by image number; by place in the row where the keys simply count."""
    if set(numbers) <= set(poses):
        return poses
    if len(poses) == len(numbers) and sorted(poses) == list(range(len(poses))):
        return {number: poses[place] for place, number in enumerate(numbers)}
    missing = [number for number in numbers if number not in poses]
    raise RecordingError(
        f"{log}: {len(poses)} poses for {len(numbers)} images; no pose for image {missing[0]}"
    )


FORMAT = Format(
    "trajectory-log",
    "trajectory.log, image|color|rgb/, depth/ and intrinsics.json",
    matches,
    read,
)
