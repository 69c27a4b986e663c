"""Recordings in the format of Microsoft's 7-Scenes: frame-N.color, frame-N.depth, frame-N.pose.

Where a folder also holds depth registered to the colour camera (frame-N.depthreg.png) and that
camera's poses (frame-N.posecolor.txt), these are read. The original files hold depth and poses of
the depth camera only; depth is then registered to the colour camera on reading.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics, find_intrinsics, load_intrinsics
from perception.camera.poses import read_pose
from perception.sources.folders.image_files import ImageFile
from perception.sources.listing import (
    DepthCamera,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    stamp_of_number,
)

DEPTH_SCALE = 1000.0
#: Kinect v1 of the data set: focal length 585 px for depth; the colour camera sits 14 mm to its
#: right with a focal length 0.903 times as long (edges of depth and colour aligned on redkitchen).
DEPTH_CAMERA = Intrinsics(585.0, 585.0, 320.0, 240.0, source="7-Scenes depth camera")
COLOUR_FOCAL_RATIO = 528.4 / 585.0
COLOUR_CENTRE_SHIFT = (-3.0, -1.4)  # [px] against the depth camera's principal point
COLOUR_OFFSET = 0.014  # [m] along the depth camera's x


def matches(folder: Path) -> bool:
    """Whether `folder` holds frame-N.color images."""
    return any(folder.glob("frame-*.color.*"))


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All frames of `folder`, by number; without poses where no frame has one.

    Raises RecordingError where a frame lacks its depth, or its pose that others have, or a pose is
    not rigid.
    """
    colours = [p for p in folder.glob("frame-*.color.*") if p.suffix in (".png", ".jpg", ".jpeg")]
    if not colours:
        raise RecordingError(f"no frame-N.color.png or frame-N.color.jpg in {folder}")
    stems = {path: path.name.split(".")[0] for path in colours}
    registered = any((folder / f"{stem}.depthreg.png").is_file() for stem in stems.values())
    depth, pose = (".depthreg.png", ".posecolor.txt") if registered else (".depth.png", ".pose.txt")
    T_depth_colour = np.eye(4)
    if not registered:
        T_depth_colour[0, 3] = COLOUR_OFFSET
    posed = any((folder / f"{stem}{pose}").is_file() for stem in stems.values())
    no_poses = "" if posed else f"{folder} has no poses: files frame-N{pose} are missing"
    entries = []
    for path in sorted(colours, key=lambda p: _number(stems[p], p)):
        stem = stems[path]
        _require(folder, stem, depth, pose if posed else depth)
        T = read_pose(folder / (stem + pose)) @ T_depth_colour if posed else np.eye(4)
        stamp = stamp_of_number(_number(stem, path))
        at_depth = ImageFile(folder / (stem + depth))
        entries.append(FrameEntry(stem, ImageFile(path), at_depth, T, stamp))
    if registered:
        return RecordingListing(
            tuple(entries), _colour_camera(folder), DEPTH_SCALE, no_poses=no_poses
        )
    camera = find_intrinsics(folder) or DEPTH_CAMERA
    depth_camera = DepthCamera(camera, np.linalg.inv(T_depth_colour).astype(np.float64))
    return RecordingListing(
        tuple(entries), _colour_camera(folder), DEPTH_SCALE, depth_camera, no_poses=no_poses
    )


def _require(folder: Path, stem: str, depth: str, pose: str) -> None:
    for suffix, what in ((depth, "depth"), (pose, "pose")):
        if not (folder / (stem + suffix)).is_file():
            raise RecordingError(f"{folder}: {stem} has no {what}: {stem}{suffix} is missing")


def _number(stem: str, path: Path) -> int:
    digits = stem.removeprefix("frame-")
    if not digits.isdecimal():
        raise RecordingError(f"{path}: expected frame-N with a number, got {stem!r}")
    return int(digits)


def _colour_camera(folder: Path) -> Intrinsics:
    if (folder / "color-intrinsics.txt").is_file():
        return load_intrinsics(folder / "color-intrinsics.txt")
    depth = find_intrinsics(folder) or DEPTH_CAMERA
    return Intrinsics(
        depth.fx * COLOUR_FOCAL_RATIO,
        depth.fy * COLOUR_FOCAL_RATIO,
        depth.cx + COLOUR_CENTRE_SHIFT[0],
        depth.cy + COLOUR_CENTRE_SHIFT[1],
        source=f"{folder}, colour camera",
    )


FORMAT = Format(
    "7scenes",
    "frame-N.color.png|jpg, frame-N.depth.png and frame-N.pose.txt",
    matches,
    read,
)
