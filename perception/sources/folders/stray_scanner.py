"""Recordings of the Stray Scanner app: phones and tablets with LiDAR (ARKit).

rgb.mp4, depth/N.png [mm], confidence/N.png (0 to 2), odometry.csv with a camera pose a frame, and
camera_matrix.csv with the 3x3 matrix of the video's frames. The world's y points up. Who holds the
phone upright records images on their side: they are turned by quarters until up is up.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics, find_intrinsics, intrinsics_from_matrix
from perception.camera.poses import LOST, Pose, pose_from_quaternion
from perception.number_tables import all_numbers, floats, text_of
from perception.sources.folders.image_files import (
    ImageFile,
    decoded,
    images_by_number,
    pairs_by_number,
    turned_upright,
)
from perception.sources.folders.video import Video, VideoFrame
from perception.sources.listing import (
    Format,
    FrameEntry,
    RecordingListing,
    StoredImage,
    Streams,
    stamp_of_number,
    subfolder,
)

DEPTH_SCALE: Final = 1000.0
UP: Final = np.array([0.0, 1.0, 0.0])  # in ARKit's world
UNSURE: Final = 0  # confidence of depth that is left out
MAX_POSES: Final = 1_000_000
_COLUMNS: Final = ("frame", "timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True, slots=True)
class ConfidentDepth:
    """A depth image without the pixels whose confidence is the least."""

    image: ImageFile
    confidence: ImageFile

    def __str__(self) -> str:
        return str(self.image)

    def check(self) -> None:
        """Raise RecordingError for a missing, truncated or damaged file."""
        self.image.check()
        self.confidence.check()

    def colour(self) -> NDArray[np.uint8]:
        """As the file's own."""
        return self.image.colour()

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return or unsure; raises RecordingError for unreadable images."""
        depth, path = self.image.depth(depth_scale), self.confidence.path
        sure = decoded(path, cv2.IMREAD_GRAYSCALE)
        if sure.shape != depth.shape:
            raise RecordingError(f"{path} and {self.image} have other sizes")
        depth[sure == UNSURE] = np.nan
        return depth


def matches(folder: Path) -> bool:
    """Whether `folder` holds rgb.mp4, and odometry.csv or depth/ beside it."""
    beside = (folder / "odometry.csv").is_file() or (folder / "depth").is_dir()
    return beside and (folder / "rgb.mp4").is_file()


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All frames of odometry.csv, stamps from 0 on.

    All frames that have a depth image, without poses, where odometry.csv is missing. Raises
    RecordingError where another file is missing or malformed, or no frame has both.
    """
    if not matches(folder):
        raise RecordingError(f"{folder} has no rgb.mp4 and odometry.csv")
    video, odometry = Video.open(folder / "rgb.mp4"), folder / "odometry.csv"
    depth = images_by_number(subfolder(folder, "depth"), (".png",))
    posed = odometry.exists()
    poses = _poses(odometry) if posed else {n: (stamp_of_number(n), np.eye(4)) for n in depth}
    if poses.keys().isdisjoint(depth):
        raise RecordingError(f"{folder}: no depth image has a pose of its number in odometry.csv")
    pairs = pairs_by_number(dict.fromkeys(poses, video.path), depth, folder)
    numbers = [number for number in pairs if number in poses]
    first = poses[numbers[0]][0]
    entries = tuple(
        FrameEntry(
            id=pairs[number][1].stem,
            colour=VideoFrame(video, number),
            depth=_depth(folder, pairs[number][1]),
            T_world_cam=poses[number][1],
            stamp=round(poses[number][0] - first, 9),
        )
        for number in numbers
    )
    missing = "" if posed else f"{folder} has no poses: {odometry.name} is missing"
    listing = RecordingListing(entries, _camera(folder, video), DEPTH_SCALE, no_poses=missing)
    return turned_upright(listing, UP) if posed else listing


def _depth(folder: Path, path: Path) -> StoredImage:
    image, confidence = ImageFile(path), folder / "confidence" / path.name
    return ConfidentDepth(image, ImageFile(confidence)) if confidence.is_file() else image


def _poses(path: Path) -> dict[int, tuple[float, Pose]]:
    """Stamp [s] and camera pose by the number of the frame."""
    found = dict[int, tuple[float, Pose]]()
    table = csv.DictReader(text_of(path).splitlines(), skipinitialspace=True)
    try:
        for row in islice(table, MAX_POSES):
            where = f"{path}, line {table.line_num}"
            number, stamp, *pose = floats((_cell(row, name, where) for name in _COLUMNS), where)
            if not (np.isfinite([number, stamp]).all() and number >= 0):
                raise RecordingError(f"{where}: frame and timestamp are finite numbers")
            t, q, lost = np.array(pose[:3]), np.array(pose[3:]), not np.isfinite(pose).all()
            found[int(number)] = stamp, LOST if lost else pose_from_quaternion(t, q, where)
    except csv.Error as error:
        raise RecordingError(f"{path} is no table of comma-separated values") from error
    return found


def _cell(row: Mapping[str, str | None], name: str, where: str) -> str:
    value = row.get(name)
    if value is None:
        raise RecordingError(
            f"{where}: no value of {name!r}; columns are timestamp, frame, x, y, z, qx, qy, qz, qw"
        )
    return value


def _camera(folder: Path, video: Video) -> Intrinsics:
    """Intrinsics of the video's frames; raises RecordingError for what is no camera matrix."""
    path, given = folder / "camera_matrix.csv", find_intrinsics(folder)
    if given is not None and not path.is_file():
        return given.fitted(*video.size)
    if not path.is_file():
        raise RecordingError(f"{path.parent} has no camera matrix: {path.name} is missing")
    K = all_numbers(path)
    if K.size != 9:
        raise RecordingError(f"{path}: a camera matrix has 9 numbers, got {K.size}")
    camera = intrinsics_from_matrix(K.reshape(3, 3), str(path))
    return replace(camera, width=video.size[0], height=video.size[1])


FORMAT = Format(
    "stray-scanner",
    "rgb.mp4, depth/N.png, odometry.csv and camera_matrix.csv of a phone",
    matches,
    read,
)
