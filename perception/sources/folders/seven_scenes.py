"""Recordings in the format of Microsoft's 7-Scenes: frame-N.color, frame-N.depth, frame-N.pose.

Where a folder also holds depth registered to the colour camera (frame-N.depthreg.png) and that
camera's poses (frame-N.posecolor.txt), these are read. The original files hold depth and poses of
the depth camera only; depth is then registered to the colour camera on reading.

BundleFusion, ScanNet's SensReader, 3RScan and 12-Scenes write the same names and info.txt, the last
beside the folder of images, which has the cameras of colour and depth and the unit of depth; poses
that were lost are -inf. Depth may be PGM, as 3RScan has it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.intrinsics import (
    Intrinsics,
    find_intrinsics,
    intrinsics_from_matrix,
    load_intrinsics,
)
from perception.camera.poses import LOST, read_pose
from perception.number_tables import floats, rows
from perception.sources.folders.image_files import entry_of, pairs_by_number
from perception.sources.listing import (
    DepthCamera,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
    first_file,
    stamp_of_number,
)

DEPTH_SCALE = 1000.0
INFO = ("info.txt", "_info.txt")
#: Kinect v1 of the data set: focal length 585 px for depth; the colour camera sits 14 mm to its
#: right with a focal length 0.903 times as long (edges of depth and colour aligned on redkitchen).
DEPTH_CAMERA = Intrinsics(585.0, 585.0, 320.0, 240.0, source="7-Scenes depth camera")
COLOUR_FOCAL_RATIO = 528.4 / 585.0
COLOUR_CENTRE_SHIFT = (-3.0, -1.4)  # [px] against the depth camera's principal point
OTHER_CAMERA = 0.01  # by which the focal length of another camera is another
COLOUR_OFFSET = 0.014  # [m] along the depth camera's x


def matches(folder: Path) -> bool:
    """Whether `folder` holds frame-N.color images."""
    return any(folder.glob("frame-*.color.*"))


def read(folder: Path, streams: Streams) -> RecordingListing:
    """All frames of `folder`, by number; without poses where no frame has one.

    Raises RecordingError where a pose is not rigid.
    """
    colours = [p for p in folder.glob("frame-*.color.*") if p.suffix in (".png", ".jpg", ".jpeg")]
    if not colours:
        raise RecordingError(f"no frame-N.color.png or frame-N.color.jpg in {folder}")
    info = first_file(folder, *INFO) or first_file(folder.resolve().parent, *INFO)
    registered = any(folder.glob("frame-*.depthreg.png"))
    depth, pose = (".depthreg", ".posecolor.txt") if registered else (".depth", ".pose.txt")
    T_depth_colour = np.eye(4)
    if not registered and info is None:
        T_depth_colour[0, 3] = COLOUR_OFFSET
    depths = folder.glob(f"frame-*{depth}.p[gn][gm]")
    pairs = pairs_by_number(_by_number(colours), _by_number(depths), folder)
    posed = any(folder.glob(f"frame-*{pose}"))
    no_poses = "" if posed else f"{folder} has no poses: files frame-N{pose} are missing"
    entries = []
    for number, (path, depth_path) in pairs.items():
        of_pose = folder / (path.name.split(".")[0] + pose)
        T = read_pose(of_pose) if of_pose.is_file() else LOST if posed else np.eye(4)
        stamp = stamp_of_number(number)
        entries.append(entry_of(path, depth_path, T @ T_depth_colour, stamp))
    if info is not None:
        return _by_info(folder, info, tuple(entries), no_poses)
    if registered:
        return RecordingListing(
            tuple(entries), _colour_camera(folder), DEPTH_SCALE, no_poses=no_poses
        )
    camera = find_intrinsics(folder) or find_intrinsics(folder.resolve().parent)
    if camera is not None and abs(camera.fx / DEPTH_CAMERA.fx - 1) > OTHER_CAMERA:
        # 3DMatch and others write these names for depth that is registered
        unmoved = tuple(
            replace(e, T_world_cam=e.T_world_cam @ np.linalg.inv(T_depth_colour)) for e in entries
        )
        return RecordingListing(unmoved, camera, DEPTH_SCALE, no_poses=no_poses)
    camera = camera or DEPTH_CAMERA
    depth_camera = DepthCamera(camera, np.linalg.inv(T_depth_colour).astype(np.float64))
    return RecordingListing(
        tuple(entries), _colour_camera(folder), DEPTH_SCALE, depth_camera, no_poses=no_poses
    )


def _by_info(
    folder: Path, info: Path, entries: tuple[FrameEntry, ...], no_poses: str
) -> RecordingListing:
    """Listing by the cameras of an info.txt; raises RecordingError where they are missing."""
    lines = (" ".join(words).partition("=") for _, words in rows(info))
    values = {key.strip(): value.split() for key, _, value in lines}

    def numbers(key: str, count: int) -> list[float]:
        found = floats(values.get(key, ()), f"{info}, {key}")
        if len(found) != count or not np.isfinite(found).all():
            raise RecordingError(f"{info}: {key} has {count} finite numbers, got {len(found)}")
        return found

    def camera(which: str) -> Intrinsics:
        K = np.array(numbers(f"m_calibration{which}Intrinsic", 16)).reshape(4, 4)[:3, :3]
        width, height = (int(numbers(f"m_{which.lower()}{x}", 1)[0]) for x in ("Width", "Height"))
        return replace(intrinsics_from_matrix(K, str(info)), width=width, height=height)

    scale = numbers("m_depthShift", 1)[0]
    colour, depth = camera("Color"), camera("Depth")
    apart = None if np.allclose(colour.K, depth.K) else DepthCamera(depth, np.eye(4))
    return RecordingListing(entries, colour, scale, apart, no_poses=no_poses)


def _by_number(paths: Iterable[Path]) -> dict[int, Path]:
    """Images called frame-N by their number; raises RecordingError for other names."""
    found = dict[int, Path]()
    for path in paths:
        digits = path.name.split(".")[0].removeprefix("frame-")
        if not digits.isdecimal():
            raise RecordingError(f"{path}: expected frame-N with a number, got frame-{digits!r}")
        found[int(digits)] = path
    return found


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
