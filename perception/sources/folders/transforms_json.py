"""Recordings of nerfstudio and of Polycam's raw export, where they hold depth.

nerfstudio: transforms.json has the camera (fl_x, fl_y, cx, cy, w, h, k1, ...) and a list of frames
with file_path, depth_file_path and transform_matrix, camera to world (the camera looks along -z
with y up). Polycam: keyframes/ has images, depth and cameras of one name; a camera has fx, fy, cx,
cy, width, height and t_00 to t_23, in a world with y up. Depth is in millimetres.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import CONVENTIONS, LOST, Pose, listed_pose
from perception.number_tables import json_object, text_of
from perception.sources.folders.image_files import (
    entry_of,
    files_in,
    images_by_number,
    pairs_by_number,
    turned_upright,
)
from perception.sources.folders.stray_scanner import UP
from perception.sources.listing import (
    Format,
    RecordingListing,
    Streams,
    stamp_of_number,
    subfolder,
)

DEPTH_SCALE: Final = 1000.0
FILE: Final = "transforms.json"
CAMERA: Final = ("fl_x", "fl_y", "cx", "cy")
MODELS: Final = ("OPENCV", "OPENCV_FISHEYE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL",
                 "PERSPECTIVE")  # fmt: skip
_log = logging.getLogger(__name__)
_IMAGES: Final = ("corrected_images", "images")
_CAMERAS: Final = ("corrected_cameras", "cameras")


def _read_transforms(folder: Path, streams: Streams) -> RecordingListing:
    """All frames of transforms.json whose images are there; without poses where none has one.

    Raises RecordingError where the file is malformed, or no frame has depth.
    """
    path = folder / FILE
    card = json_object(text_of(path), path)
    frames = card.get("frames")
    if not isinstance(frames, list) or not all(isinstance(one, dict) for one in frames):
        raise RecordingError(f"{path} has no list of frames")
    deep = [one for one in frames if isinstance(one.get("depth_file_path"), str)]
    if not deep:
        raise RecordingError(
            f"{path} has no depth: a depth_file_path in each frame (16-bit PNG, in millimetres) "
            "would work"
        )
    posed = any("transform_matrix" in one for one in deep)
    used = _present(folder, deep)
    entries = tuple(
        entry_of(
            _image(folder, one, "file_path"),
            _image(folder, one, "depth_file_path"),
            _matrix(one.get("transform_matrix"), f"{path}, frame {n}") if posed else np.eye(4),
            stamp_of_number(n),
        )
        for n, one in enumerate(used)
    )
    return RecordingListing(
        entries,
        _camera(card, used, path),
        DEPTH_SCALE,
        no_poses="" if posed else f"{folder} has no poses: no transform_matrix in {FILE}",
    )


def _read_polycam(folder: Path, streams: Streams) -> RecordingListing:
    """All key frames, with the poses of their cameras; without poses where no camera has one.

    Raises RecordingError where a file is malformed, or there are none.
    """
    inner = folder / "keyframes"
    images, cameras = subfolder(inner, *_IMAGES), subfolder(inner, *_CAMERAS)
    depths = images_by_number(subfolder(inner, "depth"), (".png",))
    pairs = pairs_by_number(images_by_number(images), depths, inner).values()
    files = {path.stem: path for path in files_in(cameras, "*.json")}
    known = [files[c.stem] for c, _ in pairs if c.stem in files]
    cards = {path.stem: json_object(text_of(path), path) for path in known}
    if not cards:
        raise RecordingError(f"{inner}: no image has a camera of its name")
    posed = any("t_00" in card for card in cards.values())
    entries = []
    for n, (colour, depth) in enumerate(pairs):
        T = LOST if posed else np.eye(4)
        if posed and colour.stem in cards:
            T = _rows(cards[colour.stem], str(files[colour.stem]))
        entries.append(entry_of(colour, depth, T, stamp_of_number(n)))
    keys = ("fx", "fy", "cx", "cy", "width", "height")
    numbers = [[_number(c, key, str(files[name])) for key in keys] for name, c in cards.items()]
    fx, fy, cx, cy, width, height = (float(x) for x in np.median(numbers, axis=0))
    upright = Intrinsics(fx, fy, cx, cy, int(width), int(height), source=str(cameras))
    missing = "" if posed else f"{folder} has no poses: no t_00 to t_23 in {cameras.name}/"
    listing = RecordingListing(tuple(entries), upright, DEPTH_SCALE, no_poses=missing)
    return turned_upright(listing, UP) if posed else listing


def _present(folder: Path, frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Frames whose images are there; who deletes blurred ones seldom edits the list."""
    keys = ("file_path", "depth_file_path")
    found = [one for one in frames if all(_image(folder, one, key).is_file() for key in keys)]
    if 0 < len(found) < len(frames):
        lost = len(frames) - len(found)
        _log.warning(
            "%s: images of %d of %d frames are missing; these are skipped",
            folder,
            lost,
            len(frames),
        )
    return found or frames


def _number(card: Mapping[str, Any], key: str, where: str) -> float:
    try:
        return float(card[key])
    except KeyError:
        raise RecordingError(f"{where}: {key} is missing") from None
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{where}: {key} is no number, but {card[key]!r}") from None


def _matrix(rows: Any, where: str) -> Pose:
    """Camera to world (4, 4) of an OpenGL camera's matrix of three or four rows; None is LOST."""
    if rows is None:
        return LOST
    try:
        T = np.array(rows, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{where}: transform_matrix is no matrix of numbers") from None
    if T.shape == (3, 4):
        T = np.vstack([T, [0, 0, 0, 1]])
    return CONVENTIONS["opengl"](listed_pose(T, where))


def _rows(card: Mapping[str, Any], where: str) -> Pose:
    return _matrix([[_number(card, f"t_{i}{j}", where) for j in range(4)] for i in range(3)], where)


def _image(folder: Path, frame: Mapping[str, Any], key: str) -> Path:
    name = frame.get(key)
    if not isinstance(name, str):
        raise RecordingError(f"{folder / FILE}: a frame has no {key}")
    path = folder / name
    return path if path.suffix else path.with_suffix(".png")


def _camera(card: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], path: Path) -> Intrinsics:
    """The camera of all frames, or the median of those of single frames."""
    of_frames = [{**card, **frame} for frame in frames]
    numbers = [[_number(one, key, str(path)) for key in CAMERA] for one in of_frames]
    fx, fy, cx, cy = (float(x) for x in np.median(numbers, axis=0))
    first = of_frames[0]
    size = [int(_number(first, key, str(path))) if key in first else None for key in ("w", "h")]
    model = str(first.get("camera_model", "OPENCV")).upper()
    if model not in MODELS:
        raise RecordingError(
            f"{path}: images of camera_model {model} are not read; known are {', '.join(MODELS)}"
        )
    fisheye = model == "OPENCV_FISHEYE"
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    dist = tuple(_number(first, key, str(path)) if key in first else 0.0 for key in names)
    return Intrinsics(fx, fy, cx, cy, size[0], size[1], dist, source=str(path), fisheye=fisheye)


TRANSFORMS = Format(
    "nerfstudio",
    "transforms.json with depth_file_path in its frames",
    lambda folder: (folder / FILE).is_file(),
    _read_transforms,
)
POLYCAM = Format(
    "polycam",
    "keyframes/ of a raw export, with images, depth and cameras",
    lambda folder: (folder / "keyframes" / "depth").is_dir(),
    _read_polycam,
)
