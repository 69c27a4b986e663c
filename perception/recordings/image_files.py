"""Image files: colour and depth decoded, and checked for truncation."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.errors import RecordingError

COLOUR_SUFFIXES = (".jpg", ".jpeg", ".png")
NO_RETURN = (0, 65535)  # 65535 marks invalid pixels in 7-Scenes and is saturation elsewhere
_PNG = b"\x89PNG\r\n\x1a\n"
_TAIL = 4096  # bytes: some cameras write notes after the end-of-image marker


def check_image_file(path: Path) -> None:
    """Raise RecordingError for a missing, truncated or damaged PNG or JPEG, without decoding it.

    A PNG carries a checksum with each of its chunks; a JPEG has only its end-of-image marker.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot read image {path}: {error.strerror}") from error
    if data.startswith(_PNG):
        _check_png(path, data)
    elif not data.startswith(b"\xff\xd8"):
        raise RecordingError(f"{path} is neither PNG nor JPEG ({len(data)} bytes)")
    elif b"\xff\xd9" not in data[-_TAIL:]:
        raise RecordingError(f"{path} is truncated after {len(data)} bytes")


def _check_png(path: Path, data: bytes) -> None:
    """Walk the chunks: length, type, data, CRC-32 of type and data (PNG specification, 5.3)."""
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if end > len(data) or place + 12 > len(data):
            raise RecordingError(f"{path} is truncated after {len(data)} bytes")
        kind = data[place + 4 : place + 8]
        if zlib.crc32(data[place + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise RecordingError(f"{path} is damaged: the checksum at byte {end - 4} is wrong")
        place = end


def _decode(path: Path, flags: int) -> NDArray[np.generic]:
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise RecordingError(f"cannot read image {path}: {error.strerror}") from error
    image: NDArray[np.generic] | None = None
    try:
        image = cv2.imdecode(data, flags) if data.size else None
    except (cv2.error, MemoryError) as error:
        # a header may name any size; OpenCV refuses more than 2^30 pixels
        raise RecordingError(
            f"{path} cannot be decoded: its header names too large a size"
        ) from error
    if image is None:
        raise RecordingError(f"{path} cannot be decoded: damaged image")
    return image


def read_colour(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(_decode(path, flags)[:, :, ::-1]).astype(np.uint8, copy=False)


def read_depth(path: Path, depth_scale: float) -> NDArray[np.float32]:
    """(H, W) [m], nan = no return, from a 16-bit image with `depth_scale` units a metre."""
    raw = _decode(path, cv2.IMREAD_UNCHANGED)
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise RecordingError(
            f"{path}: depth must be one 16-bit channel, got {raw.dtype} of shape {raw.shape}"
        )
    depth = raw.astype(np.float32) / np.float32(depth_scale)
    depth[np.isin(raw, NO_RETURN)] = np.nan
    return depth


def images_by_number(folder: Path, suffixes: Iterable[str] = COLOUR_SUFFIXES) -> dict[int, Path]:
    """Images of `folder` keyed by the last number in their name, in numeric order.

    Raises RecordingError where there is no image, a name without number, or one number twice.
    """
    found: dict[int, Path] = {}
    wanted = tuple(suffixes)
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in wanted:
            continue
        digits = "".join(c if c.isdigit() else " " for c in path.stem).split()
        if not digits:
            raise RecordingError(f"{path}: image names carry their frame number")
        if int(digits[-1]) in found:
            raise RecordingError(f"{path} and {found[int(digits[-1])].name} have the same number")
        found[int(digits[-1])] = path
    if not found:
        raise RecordingError(f"no images ({', '.join(wanted)}) in {folder}")
    return dict(sorted(found.items()))
