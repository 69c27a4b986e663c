"""Object pictures: a small JPEG of one thing in a frame, with people made unrecognisable."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.annotate import encode_jpeg

MAX_SIDE: Final = 160  # [px] side of a picture
_MARGIN: Final = 0.15  # of the box, shown around it
_BLOCKS: Final = 6  # that people are coarsened to, along each side of their part of a picture


def object_picture(
    rgb: NDArray[np.uint8],
    box: tuple[float, float, float, float],
    people: NDArray[np.float32],
    max_bytes: int,
) -> bytes | None:
    """JPEG of `box` (xyxy [px]) in an image (H, W, 3), with a margin, of `max_bytes` at most.

    The parts of it in the boxes `people` (n, 4) are coarsened beyond recognition. None where the
    box lies outside the image, or the JPEG cannot be made small enough.
    """
    height, width = rgb.shape[:2]
    x1, y1, x2, y2 = box
    margin = _MARGIN * max(x2 - x1, y2 - y1)
    left, top = max(int(x1 - margin), 0), max(int(y1 - margin), 0)
    right, bottom = min(int(x2 + margin) + 1, width), min(int(y2 + margin) + 1, height)
    if right - left < 4 or bottom - top < 4:
        return None
    picture = rgb[top:bottom, left:right].copy()
    for person in people:
        _coarsen(picture, person - np.array([left, top, left, top], np.float32))
    scale = min(MAX_SIDE / max(picture.shape[:2]), 2.0)
    size = max(round(picture.shape[1] * scale), 1), max(round(picture.shape[0] * scale), 1)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else 1)
    for quality in (80, 60, 40, 20):
        data = encode_jpeg(small.astype(np.uint8), quality)
        if len(data) <= max_bytes:
            return data
    return None


def _coarsen(picture: NDArray[np.uint8], box: NDArray[np.float32]) -> None:
    height, width = picture.shape[:2]
    x1, y1, x2, y2 = np.clip(np.round(box), 0, [width, height, width, height]).astype(int)
    if x2 <= x1 or y2 <= y1:
        return
    part = picture[y1:y2, x1:x2]
    few = cv2.resize(part, (_BLOCKS, _BLOCKS), interpolation=cv2.INTER_AREA)
    picture[y1:y2, x1:x2] = cv2.resize(few, (x2 - x1, y2 - y1), interpolation=cv2.INTER_NEAREST)
