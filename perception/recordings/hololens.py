"""Recordings with numbered images and one pose a line, as HoloLens exporters write them.

images/ (or rgb/) and depth/ in one number order, poses.txt with a camera -> world matrix of 16
numbers a line (row by row), K.txt with the 3x3 matrix of the colour camera.
"""

from __future__ import annotations

from pathlib import Path

from kg.errors import RecordingError
from perception.camera.intrinsics import find_intrinsics
from perception.camera.poses import read_pose_rows
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
    """Whether `folder` holds poses.txt."""
    return (folder / "poses.txt").is_file()


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All images of `folder` in number order, the n-th with the n-th depth image and pose.

    Raises RecordingError where the three counts differ, or numbers that colour and depth share
    would not meet.
    """
    if not matches(folder):
        raise RecordingError(f"{folder} has no poses: poses.txt is missing")
    poses = read_pose_rows(folder / "poses.txt")
    colour = images_by_number(subfolder(folder, "images", "rgb"))
    depth = images_by_number(subfolder(folder, "depth"), (".png",))
    if not len(colour) == len(depth) == len(poses):
        raise RecordingError(
            f"{folder}: {len(colour)} colour images, {len(depth)} depth images and "
            f"{len(poses)} poses; there must be as many of each"
        )
    _check_gaps(folder, list(colour), list(depth))
    entries = tuple(
        FrameEntry(path.stem, ImageFile(path), ImageFile(depth_path), T, stamp_of_number(place))
        for place, (path, depth_path, T) in enumerate(
            zip(colour.values(), depth.values(), poses, strict=True)
        )
    )
    return RecordingListing(entries, find_intrinsics(folder), DEPTH_SCALE)


def _check_gaps(folder: Path, colour: list[int], depth: list[int]) -> None:
    """Refuse colour without image 3 beside depth without image 5: their places do not correspond.

    Another first number, or other numbers altogether (time stamps of two cameras), are fine.
    """
    apart = {d - c for c, d in zip(colour, depth, strict=True)}
    if len(apart) > 1 and not set(colour).isdisjoint(depth):
        lone = min(set(colour) ^ set(depth))
        lacks = "depth" if lone in colour else "colour"
        raise RecordingError(f"{folder}: image {lone} has no {lacks} image of its number")


FORMAT = Format("hololens", "images|rgb/, depth/, poses.txt and K.txt", matches, read)
