"""Folders of data sets with layouts of their own: ARKitScenes and SUN3D.

ARKitScenes (Baruch et al., NeurIPS 2021): lowres_wide/ and lowres_depth/ (millimetres) with stamps
in their names, lowres_wide_intrinsics/ with `width height fx fy cx cy` of each, and
lowres_wide.traj, whose lines are `stamp rx ry rz tx ty tz`: world to camera, by a rotation vector.

SUN3D (Xiao et al., ICCV 2013): image/ and depth/ with the number of a frame and its microseconds in
the names, intrinsics.txt, and extrinsics/ with a file of three rows of camera to world a frame, of
which the last is the newest. The three lowest bits of a depth [mm] are its highest ones.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MILLIMETRES, metres
from perception.camera.intrinsics import Intrinsics, find_intrinsics
from perception.camera.poses import (
    CONVENTIONS,
    Pose,
    Trajectory,
    listed_pose,
    quaternion_from_pose,
)
from perception.number_tables import floats, rows
from perception.sources.folders.image_files import (
    COLOUR_SUFFIXES,
    DEPTH_SUFFIXES,
    ImageFile,
    decoded,
    entry_of,
    files_in,
    images_by_number,
    with_poses,
)
from perception.sources.folders.numbered_images import pairs_by_stamp
from perception.sources.listing import (
    TOLERANCE,
    Format,
    RecordingListing,
    Streams,
    nearest_pairs,
    subfolder,
)

TRAJECTORY: Final = "lowres_wide.traj"
_STAMP: Final = re.compile(r"(?<=_)\d+\.\d+$")  # [s] at the end of a name
SUN3D_TOLERANCE: Final = 0.02  # [s] between colour and depth


def _read_arkit_scenes(folder: Path, streams: Streams) -> RecordingListing:
    """All colour images with depth; raises RecordingError for malformed lines."""
    wide, depth = subfolder(folder, "lowres_wide"), subfolder(folder, "lowres_depth")
    pairs = pairs_by_stamp(wide, depth, _STAMP)
    if not pairs:
        raise RecordingError(f"{wide}: names of images do not end with a stamp, as in a_12.3.png")
    cameras = files_in(folder / "lowres_wide_intrinsics", "*.pincam")
    camera = find_intrinsics(folder)
    if cameras and camera is None:
        where, words = next(rows(cameras[0]), (str(cameras[0]), []))
        numbers = floats(words, where)
        if len(numbers) != 6 or not np.isfinite(numbers).all():
            raise RecordingError(f"{where}: expected width height fx fy cx cy, got {words}")
        width, height, fx, fy, cx, cy = numbers
        camera = Intrinsics(fx, fy, cx, cy, int(width), int(height), source=where)
    trajectory = _trajectory(folder / TRAJECTORY)
    entries = tuple(entry_of(a, b, np.eye(4), stamp) for a, b, stamp in pairs)
    entries = with_poses(entries, lambda entry: trajectory.at(entry.stamp, TOLERANCE))
    missing = f"{folder}: no image has a pose in {TRAJECTORY} (poses: {trajectory.reach})"
    up = np.array([0.0, 0.0, 1.0])
    return RecordingListing(entries, camera, MILLIMETRES, up=up, no_pose_found=missing)


def _trajectory(path: Path) -> Trajectory:
    """Poses of the camera; raises RecordingError for malformed lines."""
    stamps, places, turns = list[float](), list[Pose](), list[Pose]()
    for where, words in rows(path):
        numbers = np.array(floats(words, where))
        if len(numbers) != 7 or not np.isfinite(numbers).all():
            raise RecordingError(f"{where}: expected stamp rx ry rz tx ty tz, got {words}")
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = cv2.Rodrigues(numbers[1:4])[0], numbers[4:]
        T = CONVENTIONS["world-to-camera"](T)
        stamps.append(float(numbers[0]))
        places.append(T[:3, 3])
        turns.append(quaternion_from_pose(T))
    order = np.argsort(stamps, kind="stable")
    t, q = np.reshape(places, (-1, 3))[order], np.reshape(turns, (-1, 4))[order]
    return Trajectory(np.array(stamps)[order], t, q)


@dataclass(frozen=True, slots=True)
class TurnedBits(ImageFile):
    """A depth image of SUN3D."""

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; raises RecordingError for an unreadable image."""
        raw = decoded(self.path, cv2.IMREAD_UNCHANGED)
        if raw.dtype != np.uint16 or raw.ndim != 2:
            raise RecordingError(f"{self.path}: depth of SUN3D has 16 bits, got {raw.dtype}")
        return metres((raw >> np.uint16(3)) | (raw << np.uint16(13)), depth_scale)


def _read_sun3d(folder: Path, streams: Streams) -> RecordingListing:
    """All colour images with the depth image of the nearest time."""
    files = files_in(folder / "extrinsics", "*.txt")
    table = [floats(words, where) for where, words in rows(files[-1])] if files else []
    kinds = (("image", COLOUR_SUFFIXES), ("depth", DEPTH_SUFFIXES))
    colour, depth = (images_by_number(folder / name, suffixes) for name, suffixes in kinds)
    paths = [*colour.values()], [*depth.values()]
    seconds = [np.array([int(re.findall(r"\d+", p.stem)[-1]) / 1e6 for p in one]) for one in paths]
    if any(len(row) != 4 for row in table) or len(table) != 3 * len(paths[0]):
        raise RecordingError(
            f"{folder}: {len(paths[0])} images, and {len(table)} rows of poses in extrinsics/; "
            "three rows of four numbers each would work, or --poses FILE"
        )
    poses = np.tile(np.eye(4), (len(paths[0]), 1, 1))
    poses[:, :3] = np.array(table).reshape(-1, 3, 4)
    entries = []
    for i, j in sorted(nearest_pairs(seconds[0], seconds[1], SUN3D_TOLERANCE)):
        a, b = paths[0][i], paths[1][j]
        T = listed_pose(poses[i], f"{files[-1]}, pose {i}")
        entries.append(replace(entry_of(a, b, T, float(seconds[0][i])), depth=TurnedBits(b)))
    return RecordingListing(tuple(entries), find_intrinsics(folder), MILLIMETRES)


DATASETS: Final = (
    Format(
        "arkit-scenes",
        f"lowres_wide/, lowres_depth/, lowres_wide_intrinsics/ and {TRAJECTORY}",
        lambda folder: (folder / TRAJECTORY).is_file() and (folder / "lowres_depth").is_dir(),
        _read_arkit_scenes,
    ),
    Format(
        "sun3d",
        "image/, depth/, extrinsics/ and intrinsics.txt",
        lambda folder: all((folder / n).is_dir() for n in ("image", "depth", "extrinsics")),
        _read_sun3d,
    ),
)
