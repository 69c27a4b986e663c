"""Decoding of PNG and JPEG bytes, and of raw depth into metres."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.errors import RecordingError

NO_RETURN: Final = (0, 65535)  # 65535 marks invalid pixels in 7-Scenes, elsewhere saturation
MOST_PIXELS: Final = 1 << 27
MILLIMETRES: Final = 1000.0  # units a metre of 16-bit depth, where nothing else is said


def decode_image(data: NDArray[np.uint8], flags: int, where: str) -> NDArray[Any]:
    """Decoded image; raises RecordingError, beginning with `where`, for a damaged one."""
    image: NDArray[Any] | None = None
    if _png_pixels(data) > MOST_PIXELS:
        raise RecordingError(f"{where} cannot be decoded: its header names too large a size")
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


def _png_pixels(data: NDArray[np.uint8]) -> int:
    """Pixels that the header of a PNG names: kilobytes may expand to gigabytes; 0 for others."""
    if data[:8].tobytes() != b"\x89PNG\r\n\x1a\n":
        return 0
    width, height = data[16:20].tobytes(), data[20:24].tobytes()
    return int.from_bytes(width, "big") * int.from_bytes(height, "big")


def metres(
    raw: NDArray[np.uint16] | NDArray[np.float32], depth_scale: float
) -> NDArray[np.float32]:
    """Depth (H, W) [m], nan = no return, of an image with `depth_scale` units a metre.

    Floats are metres where `depth_scale` is MILLIMETRES, and otherwise off by the same factor.
    """
    if raw.dtype == np.uint16:
        depth = raw.astype(np.float32) / np.float32(depth_scale)
        depth[np.isin(raw, NO_RETURN)] = np.nan
        return depth
    depth = raw.astype(np.float32)
    if depth_scale != MILLIMETRES:
        depth /= np.float32(depth_scale / MILLIMETRES)
    with np.errstate(invalid="ignore"):
        depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    return depth
