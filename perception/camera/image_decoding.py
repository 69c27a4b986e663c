"""Decoding of PNG and JPEG bytes, and of raw depth into metres."""

from __future__ import annotations

import zlib
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError, RecordingError

NO_RETURN: Final = (0, 65535)  # 65535 marks invalid pixels in 7-Scenes, elsewhere saturation
MAX_PIXELS: Final = 1 << 27
PLAIN: Final = 4.0  # standard deviation of the grey values below which a picture shows nothing
PNG: Final = b"\x89PNG\r\n\x1a\n"
MILLIMETRES: Final = 1000.0  # units a metre of 16-bit depth, where nothing else is said


def decode_image(data: NDArray[np.uint8], flags: int, where: str) -> NDArray[Any]:
    """Decoded image; raises RecordingError, beginning with `where`, for a damaged one."""
    image: NDArray[Any] | None = None
    if data[: len(PNG)].tobytes() == PNG:
        _check_pixels(data, where)
        check_png(data.data, where)  # libpng would complain on a line of its own
    try:
        image = cv2.imdecode(data, flags) if data.size else None
    except (cv2.error, MemoryError) as error:
        # a header may name any size; OpenCV refuses more than 2^30 pixels
        raise RecordingError(
            f"{where} cannot be decoded: its header names too large a size"
        ) from error
    if image is None:
        raise RecordingError(f"{where} cannot be decoded: damaged image")
    return image


def decode_picture(picture: bytes) -> NDArray[np.uint8]:
    """Image (H, W, 3) of a JPEG or PNG of a thing.

    Raises RecordingError for a damaged picture, and ModelError for one that shows nothing.
    """
    data = np.frombuffer(picture, np.uint8)
    bgr = np.asarray(decode_image(data, cv2.IMREAD_COLOR, "the picture"), np.uint8)
    if bgr.mean(axis=2).std() < PLAIN:
        raise ModelError("the picture shows nothing: it has one colour")
    return np.ascontiguousarray(bgr[:, :, ::-1])


def _check_pixels(png: NDArray[np.uint8], where: str) -> None:
    """Refuse a PNG whose header names too many pixels: kilobytes may expand to gigabytes."""
    width, height = (int.from_bytes(png[place : place + 4].tobytes(), "big") for place in (16, 20))
    if width * height > MAX_PIXELS:
        raise RecordingError(f"{where} cannot be decoded: its header names too large a size")


def check_png(data: bytes | memoryview, where: str) -> None:
    """Raise RecordingError for a PNG that is truncated or damaged, without decoding it.

    Walks the chunks: length, type, data, CRC-32 of type and data (PNG specification, 5.3).
    """
    place, kind = len(PNG), b""
    while kind != b"IEND":
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if end > len(data) or place + 12 > len(data):
            raise RecordingError(f"{where} is truncated after {len(data)} bytes")
        kind = bytes(data[place + 4 : place + 8])
        if zlib.crc32(data[place + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise RecordingError(f"{where} is damaged: the checksum at byte {end - 4} is wrong")
        place = end


def metres(raw: NDArray[Any], depth_scale: float) -> NDArray[np.float32]:
    """Depth (H, W) [m], nan = no return, of an image with `depth_scale` units a metre.

    Floats are metres where `depth_scale` is MILLIMETRES, and otherwise off by the same factor.
    """
    if raw.dtype.kind in "iu":
        depth = raw.astype(np.float32) / np.float32(depth_scale)
        depth[np.isin(raw, NO_RETURN) | (raw < 0) | (raw == np.iinfo(raw.dtype).max)] = np.nan
        return depth
    depth = raw.astype(np.float32)
    if depth_scale != MILLIMETRES:
        depth /= np.float32(depth_scale / MILLIMETRES)
    with np.errstate(invalid="ignore"):
        depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    return depth
