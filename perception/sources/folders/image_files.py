"""Image files: colour and depth decoded, and checked for truncation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import read_bytes
from perception.camera.image_decoding import PNG, check_png, decode_image, metres

COLOUR_SUFFIXES = (".jpg", ".jpeg", ".png")
_TAIL = 4096  # bytes: some cameras write notes after the end-of-image marker


def check_image_file(path: Path) -> None:
    """Raise RecordingError for a missing, truncated or damaged PNG or JPEG, without decoding it.

    A PNG carries a checksum with each of its chunks; a JPEG has only its end-of-image marker.
    """
    data = _bytes_of(path).tobytes()
    if data.startswith(PNG):
        check_png(data, str(path))
    elif not data.startswith(b"\xff\xd8"):
        raise RecordingError(f"{path} is neither PNG nor JPEG ({len(data)} bytes)")
    elif b"\xff\xd9" not in data[-_TAIL:]:
        raise RecordingError(f"{path} is truncated after {len(data)} bytes")


def decoded(path: Path, flags: int) -> NDArray[Any]:
    """The image by the `flags` of cv2.imdecode; raises RecordingError for an unreadable one."""
    return decode_image(_bytes_of(path), flags, str(path))


def _bytes_of(path: Path) -> NDArray[np.uint8]:
    try:
        return np.frombuffer(read_bytes(path), np.uint8)
    except OSError as error:
        raise RecordingError(f"cannot read image {path}: {error.strerror}") from error


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image of a recording that is a file."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    def check(self) -> None:
        """Raise RecordingError for a missing, truncated or damaged file."""
        check_image_file(self.path)

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return read_colour(self.path)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return, from a 16-bit image with `depth_scale` units a metre."""
        return read_depth(self.path, depth_scale)


def read_colour(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(decoded(path, flags)[:, :, ::-1]).astype(np.uint8, copy=False)


def read_depth(path: Path, depth_scale: float) -> NDArray[np.float32]:
    """(H, W) [m], nan = no return, from a 16-bit image with `depth_scale` units a metre."""
    raw = decoded(path, cv2.IMREAD_UNCHANGED)
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise RecordingError(
            f"{path}: depth must be one 16-bit channel, got {raw.dtype} of shape {raw.shape}"
        )
    return metres(raw, depth_scale)


def images_by_number(folder: Path, suffixes: Iterable[str] = COLOUR_SUFFIXES) -> dict[int, Path]:
    """Images of `folder` keyed by the last number in their name, in numeric order.

    Raises RecordingError where there is no image, a name without number, or one number twice.
    """
    found: dict[int, Path] = {}
    wanted = tuple(suffixes)
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in wanted:
            continue
        digits = "".join(c if c.isdecimal() else " " for c in path.stem).split()
        if not digits:
            raise RecordingError(f"{path}: image names carry their frame number")
        if int(digits[-1]) in found:
            raise RecordingError(f"{path} and {found[int(digits[-1])].name} have the same number")
        found[int(digits[-1])] = path
    if not found:
        raise RecordingError(f"no images ({', '.join(wanted)}) in {folder}")
    return dict(sorted(found.items()))
