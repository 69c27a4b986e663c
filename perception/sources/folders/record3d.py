"""Recordings of the Record3D app: a phone's .r3d files.

An .r3d is a zip: `metadata` (JSON) with the size and the 3x3 matrix K of the camera, column by
column, and a pose a frame (qx qy qz qw x y z; the camera looks along -z with y up, and the world's
y points up); rgbd/N.jpg; rgbd/N.depth, floats [m], and rgbd/N.conf, bytes from 0 to 2, both
compressed by LZFSE. Layout: the author's answers in the issues of github.com/marek-simonik/record3d
(7, 27, 81, 93). The blocks of LZFSE: github.com/lzfse/lzfse, lzfse_internal.h.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from math import isfinite, sqrt
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import check_regular
from perception.camera.image_decoding import MILLIMETRES, decode_image, metres
from perception.camera.intrinsics import Intrinsics, intrinsics_from_matrix
from perception.camera.poses import CONVENTIONS, Pose, pose_from_quaternion
from perception.number_tables import json_object
from perception.sources.folders.image_files import turned_upright
from perception.sources.folders.stray_scanner import UNSURE, UP
from perception.sources.listing import FRAME_RATE, Format, FrameEntry, RecordingListing, Streams

MAX_FILE: Final = 1 << 40  # [bytes]
MAX_METADATA: Final = 1 << 27  # [bytes]
MAX_IMAGE: Final = 1 << 25  # [bytes] of an image, compressed and not
_PER_FRAME: Final = "perFrameIntrinsicCoeffs"


class Archive:
    """The files of an .r3d file, by name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            check_regular(path, MAX_FILE)
            self._zip = zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile, ValueError) as error:
            raise RecordingError(f"{path} is no zip, as .r3d files are: {error}") from error
        self.names: Final = frozenset(self._zip.namelist())

    def member(self, name: str, max_bytes: int = MAX_IMAGE) -> bytes:
        """Content of a file; raises RecordingError where it is missing or damaged."""
        try:
            if self._zip.getinfo(name).file_size > max_bytes:
                raise RecordingError(f"{self.path}: {name} has more than {max_bytes:,} bytes")
            return self._zip.read(name)
        except KeyError:
            raise RecordingError(f"{self.path} has no {name}") from None
        except (OSError, zipfile.BadZipFile, zlib.error, ValueError, NotImplementedError,
                RuntimeError) as error:  # fmt: skip
            raise RecordingError(f"{self.path}: {name} cannot be read: {error}") from error


@dataclass(frozen=True, slots=True)
class Record3DImage:
    """A colour image of the file, or a depth image without the pixels of least confidence."""

    archive: Archive
    number: int
    size: tuple[int, int] | None = None  # (width, height) of depth images, where the file says it
    aspect: float = 1.0  # width / height, where it does not
    confidence: bool = False  # whether the frame has an image of it

    def __str__(self) -> str:
        return f"{self.archive.path}, rgbd/{self.number}"

    def check(self) -> None:
        """Nothing: zip keeps a checksum of each file, which is checked as it is read."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        data = np.frombuffer(self.archive.member(f"rgbd/{self.number}.jpg"), np.uint8)
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        image = decode_image(data, flags, str(self))
        return np.ascontiguousarray(image[:, :, ::-1]).astype(np.uint8, copy=False)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return or unsure; raises RecordingError for unreadable images."""
        floats = np.frombuffer(self._unpacked("depth", 4), "<f4")
        width, height = self.size or _size(floats.size, self.aspect)
        if width * height != floats.size:
            raise RecordingError(f"{self}.depth has {floats.size} pixels, not {width} x {height}")
        depth = metres(floats.reshape(height, width), depth_scale)
        if self.confidence:
            sure = np.frombuffer(self._unpacked("conf", 1), np.uint8)
            if sure.size != depth.size:
                raise RecordingError(f"{self}: its confidence and its depth have other sizes")
            depth[sure.reshape(depth.shape) == UNSURE] = np.nan
        return depth

    def _unpacked(self, suffix: str, item: int) -> bytes:
        """Content of a compressed file of `item` bytes a pixel."""
        lzfse, where = import_module("lzfse"), f"{self}.{suffix}"
        data = self.archive.member(f"rgbd/{self.number}.{suffix}")
        size = _unpacked_size(data, where)
        try:
            unpacked: bytes = lzfse.decompress(data)
        except (lzfse.error, MemoryError) as error:
            raise RecordingError(f"{where} is damaged: it is not compressed by LZFSE") from error
        if len(unpacked) != size or size % item:
            raise RecordingError(f"{where} is damaged: {len(unpacked)} bytes")
        return unpacked


def matches(path: Path) -> bool:
    """Whether `path` is a file called .r3d."""
    return path.suffix.lower() == ".r3d" and path.is_file()


def read(path: Path, streams: Streams) -> RecordingListing:
    """All frames with colour and depth; without poses where the file has none.

    Raises RecordingError where the package lzfse is missing, or the file is malformed.
    """
    if find_spec("lzfse") is None:
        raise RecordingError(
            f"{path} needs the package lzfse: pip install 'hereabouts[record3d]' brings it"
        )
    archive = Archive(path)
    card = json_object(archive.member("metadata", MAX_METADATA), f"{path}: its metadata")
    names = archive.names
    numbers = sorted(
        int(name[5:-6])
        for name in names
        if name.startswith("rgbd/") and name.endswith(".depth") and name[5:-6].isdecimal()
        if f"{name[:-6]}.jpg" in names
    )
    if not numbers:
        raise RecordingError(f"{path} has no depth: rgbd/N.jpg and rgbd/N.depth would work")
    poses, why = _poses(card, numbers, path)
    camera, size = _camera(card, numbers, path), _depth_size(card, path)
    stamps = _stamps(card, numbers, path)
    assert camera.width is not None and camera.height is not None
    aspect = camera.width / camera.height
    entries = tuple(
        FrameEntry(
            id=f"{number:06}",
            colour=Record3DImage(archive, number),
            depth=Record3DImage(archive, number, size, aspect, f"rgbd/{number}.conf" in names),
            T_world_cam=T,
            stamp=round(stamp - stamps[0], 9),
        )
        for number, T, stamp in zip(numbers, poses, stamps, strict=True)
    )
    listing = RecordingListing(entries, camera, MILLIMETRES, no_poses=why)
    return listing if why else turned_upright(listing, UP)


def _poses(card: dict[str, Any], numbers: list[int], path: Path) -> tuple[list[Pose], str]:
    """Camera poses of the frames, and why they are none; "" where they are."""
    if not card.get("poses"):
        return [np.eye(4)] * len(numbers), f"{path} has no poses in its metadata"
    rows = _table(card, "poses", 7, numbers, path)
    poses = [pose_from_quaternion(r[4:], r[:4], f"{path}, pose {n}")
             for n, r in zip(numbers, rows, strict=True)]  # fmt: skip
    if len(poses) > 1 and all(np.array_equal(poses[0], T) for T in poses):
        # the camera beside the screen is not tracked
        return [np.eye(4)] * len(numbers), f"{path} has one pose for all of its frames"
    return [CONVENTIONS["opengl"](T) for T in poses], ""


def _camera(card: dict[str, Any], numbers: list[int], path: Path) -> Intrinsics:
    """The camera of all frames, or the median of those of single frames."""
    (width,), (height,) = (_row(card.get(key), 1, f"{path}: {key}") for key in ("w", "h"))
    if min(width, height) < 1:
        raise RecordingError(f"{path}: images of {width:g} x {height:g} pixels")
    if card.get(_PER_FRAME):
        fx, fy, cx, cy = np.median(_table(card, _PER_FRAME, 4, numbers, path), axis=0)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    else:
        K = _row(card.get("K"), 9, f"{path}: K").reshape(3, 3).T
    return replace(intrinsics_from_matrix(K, str(path)), width=int(width), height=int(height))


def _stamps(card: dict[str, Any], numbers: list[int], path: Path) -> list[float]:
    if card.get("frameTimestamps"):
        return [float(row[0]) for row in _table(card, "frameTimestamps", 1, numbers, path)]
    rate = float(_row(card.get("fps", FRAME_RATE), 1, f"{path}: fps")[0])
    return [number / rate if rate > 0 else number / FRAME_RATE for number in numbers]


def _depth_size(card: dict[str, Any], path: Path) -> tuple[int, int] | None:
    if "dw" not in card or "dh" not in card:
        return None
    (width,), (height,) = (_row(card[key], 1, f"{path}: {key}") for key in ("dw", "dh"))
    return int(width), int(height)


def _size(pixels: int, aspect: float) -> tuple[int, int]:
    """(width, height) of an image of so many pixels."""
    width = round(sqrt(pixels * aspect))
    return width, pixels // max(width, 1)


def _table(
    card: dict[str, Any], key: str, columns: int, numbers: list[int], path: Path
) -> list[NDArray[np.float64]]:
    """Rows of numbers, one for each frame."""
    rows = card[key]
    if not isinstance(rows, list) or len(rows) <= numbers[-1]:
        count = len(rows) if isinstance(rows, list) else "no list"
        raise RecordingError(f"{path}: {key} has {count} of {numbers[-1] + 1} rows")
    return [_row(rows[number], columns, f"{path}: {key}, row {number}") for number in numbers]


def _row(given: Any, columns: int, where: str) -> NDArray[np.float64]:
    row = given if isinstance(given, list) else [given]
    fine = len(row) == columns and all(isinstance(x, int | float) for x in row)
    if not fine or not all(isfinite(x) for x in row):
        raise RecordingError(f"{where} is not {columns} finite numbers, but {str(given)[:60]}")
    return np.array(row, np.float64)


def _unpacked_size(data: bytes, where: str) -> int:
    """Bytes that LZFSE's blocks expand to; kilobytes of them may name gigabytes."""
    place, size = 0, 0
    try:
        while data[place : place + 4] != b"bvx$":
            kind, expands = struct.unpack_from("<4sI", data, place)
            size += expands
            if kind == b"bvx2":
                literals, matches = struct.unpack_from("<QQ", data, place + 8)
                (header,) = struct.unpack_from("<I", data, place + 24)
                place += header + (literals >> 20 & 0xFFFFF) + (matches >> 40 & 0xFFFFF)
                place += 0 if header >= 32 else len(data)
            elif kind == b"bvxn":
                place += 12 + struct.unpack_from("<I", data, place + 8)[0]
            elif kind == b"bvx-":
                place += 8 + expands
            else:
                raise RecordingError(f"{where} is damaged: it is not compressed by LZFSE")
    except struct.error:
        raise RecordingError(f"{where} is damaged: it ends too early") from None
    if size > MAX_IMAGE:
        raise RecordingError(f"{where} expands to more than {MAX_IMAGE:,} bytes")
    return size


FORMAT = Format("record3d", "an .r3d file of a phone", matches, read)
