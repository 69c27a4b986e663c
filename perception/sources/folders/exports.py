"""Folders that other programs export: RTAB-Map's, BOP's, and an image, depth and pose by name.

RTAB-Map's: rtabmap_rgb/, rtabmap_depth/ (millimetres) with stamps as names, rtabmap_calib/ with the
camera of each, and rtabmap_camera_poses.txt; or rtabmap_poses.txt of the robot's base, which the
camera's `local_transform` joins to the camera.

BOP's (Hodan et al., ECCV 2018): rgb/, depth/, and scene_camera.json with K, the unit of depth [mm]
and the pose of the world in the camera [mm] of each image, by its number.

Posed images, as mmdetection3d exports ScanNet: N.jpg, N.png (millimetres) and N.txt beside each
other, and intrinsic.txt.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from perception.camera.image_decoding import MILLIMETRES
from perception.camera.intrinsics import (
    find_intrinsics,
    intrinsics_from_matrix,
    load_intrinsics,
    yaml_matrix,
)
from perception.camera.poses import (
    CONVENTIONS,
    LOST,
    Pose,
    listed_pose,
    read_pose,
    read_trajectory,
)
from perception.sources.folders.image_files import (
    COLOUR_SUFFIXES,
    DEPTH_SUFFIXES,
    entry_of,
    files_in,
    images_by_number,
    pairs_by_number,
    with_poses,
)
from perception.sources.folders.numbered_images import pairs_by_stamp
from perception.sources.listing import (
    TOLERANCE,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    first_file,
    stamp_of_number,
    subfolder,
)

RTABMAP: Final = ("rtabmap_rgb", "rtabmap_depth")
RTABMAP_POSES: Final = ("rtabmap_camera_poses.txt", "rtabmap_poses.txt")  # the second: of the base
BOP_FILE: Final = "scene_camera.json"


def _read_rtabmap(folder: Path, streams: Streams) -> RecordingListing:
    """All images that have depth; raises RecordingError where none has."""
    colour, depth = (subfolder(folder, name) for name in RTABMAP)
    pairs = pairs_by_stamp(colour, depth)
    if not pairs:
        raise RecordingError(
            f"{colour}: names of images are no stamps; rtabmap-export with --images and without "
            "--images_id writes such"
        )
    calibrations = files_in(folder / "rtabmap_calib", "*.yaml")
    camera = load_intrinsics(calibrations[0]) if calibrations else find_intrinsics(folder)
    poses = first_file(folder, *RTABMAP_POSES)
    entries = tuple(entry_of(a, b, np.eye(4), stamp) for a, b, stamp in pairs)
    if poses is None:
        missing = f"{folder} has no poses: {RTABMAP_POSES[0]} is missing"
        return RecordingListing(entries, camera, MILLIMETRES, no_poses=missing)
    T_base_camera = np.eye(4)
    if poses.name == RTABMAP_POSES[1]:
        mount = yaml_matrix(calibrations[0], "local_transform") if calibrations else None
        if mount is None or mount.size != 12:
            raise RecordingError(
                f"{poses} has poses of the robot's base, and no local_transform in rtabmap_calib/ "
                f"joins it to the camera; {RTABMAP_POSES[0]} of `rtabmap-export --poses_camera` "
                "would work"
            )
        T_base_camera[:3] = mount.reshape(3, 4)
    trajectory = read_trajectory(poses)

    def pose_of(entry: FrameEntry) -> Pose | None:
        T = trajectory.at(entry.stamp, TOLERANCE)
        return None if T is None else T @ T_base_camera

    missing = f"{folder}: no image has a pose in {poses.name}"
    entries = with_poses(entries, pose_of)
    return RecordingListing(entries, camera, MILLIMETRES, no_pose_found=missing)


def _read_bop(folder: Path, streams: Streams) -> RecordingListing:
    """All images by number; raises RecordingError for malformed cameras."""
    file = folder / BOP_FILE
    try:
        cards: dict[str, Any] = json.loads(read_text(file))
        cameras = {int(number): card for number, card in cards.items()}
        first = cameras[min(cameras)]
        K = np.array(first["cam_K"], np.float64).reshape(3, 3)
        scale = MILLIMETRES / float(first.get("depth_scale", 1.0))
        poses = {
            number: _pose_of_bop(card, f"{file}, image {number}")
            for number, card in cameras.items()
            if "cam_R_w2c" in card
        }
    except (OSError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise RecordingError(f"{file} is no scene_camera.json of BOP: {error!r}") from error
    colour = images_by_number(subfolder(folder, "rgb"))
    depth = images_by_number(subfolder(folder, "depth"), DEPTH_SUFFIXES)
    entries = tuple(
        entry_of(*pair, poses.get(number, LOST if poses else np.eye(4)), stamp_of_number(number))
        for number, pair in pairs_by_number(colour, depth, folder).items()
    )
    no_poses = "" if poses else f"{file} has no cam_R_w2c: poses of the camera are missing"
    camera = intrinsics_from_matrix(K, str(file))
    return RecordingListing(entries, camera, scale, no_poses=no_poses)


def _pose_of_bop(card: dict[str, Any], where: str) -> Pose:
    T = np.eye(4)
    T[:3, :3] = np.array(card["cam_R_w2c"], np.float64).reshape(3, 3)
    T[:3, 3] = np.array(card["cam_t_w2c"], np.float64) / MILLIMETRES
    return CONVENTIONS["world-to-camera"](listed_pose(T, where))


def _read_posed_images(folder: Path, streams: Streams) -> RecordingListing:
    """All images, with the poses that are there."""
    numbered = [path for path in files_in(folder) if path.stem.isdecimal()]
    colour, depth, poses = (
        {int(path.stem): path for path in numbered if path.suffix in suffixes}
        for suffixes in (COLOUR_SUFFIXES[:2], (".png",), (".txt",))
    )
    entries = [
        entry_of(*pair, read_pose(poses[n]) if n in poses else LOST, stamp_of_number(n))
        for n, pair in pairs_by_number(colour, depth, folder).items()
    ]
    file = first_file(folder, "intrinsic.txt")
    camera = find_intrinsics(folder) if file is None else load_intrinsics(file)
    return RecordingListing(tuple(entries), camera, MILLIMETRES)


def _is_posed(folder: Path) -> bool:
    """Whether there is a colour image with a depth image and a pose of its number beside it."""
    return folder.is_dir() and any(
        path.suffix in COLOUR_SUFFIXES[:2]
        and path.stem.isdecimal()
        and all(path.with_suffix(suffix).is_file() for suffix in (".png", ".txt"))
        for path in files_in(folder)
    )


EXPORTS: Final = (
    Format(
        "rtabmap",
        "rtabmap_rgb/, rtabmap_depth/, rtabmap_calib/ and rtabmap_camera_poses.txt",
        lambda folder: all((folder / name).is_dir() for name in RTABMAP),
        _read_rtabmap,
    ),
    Format(
        "bop",
        f"rgb/, depth/ and {BOP_FILE}",
        lambda folder: (folder / BOP_FILE).is_file() and (folder / "depth").is_dir(),
        _read_bop,
    ),
    Format(
        "posed-images",
        "N.jpg, N.png, N.txt and intrinsic.txt",
        _is_posed,
        _read_posed_images,
    ),
)
