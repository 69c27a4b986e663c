"""Preprocessing of images to the size and values of a network's input, and of boxes back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

PAD = 114  # grey that letterboxed networks were trained with
CROP_MARGIN = 256 / 224  # shorter side over crop, as classifiers are evaluated
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32) * 255
IMAGENET_SCALE = np.array([0.229, 0.224, 0.225], np.float32) * 255
RESIZES = ("stretch", "letterbox", "crop")
VALUES = ("0..255", "0..1", "imagenet", "0..255 bgr", "0..1 bgr", "imagenet bgr")


@dataclass(frozen=True, slots=True)
class Fitted:
    """A network's input, and the way back: image pixel = (input pixel - shift) / scale."""

    tensor: NDArray[np.float32]  # (1, 3, H, W)
    scale: tuple[float, float]  # x, y
    shift: tuple[float, float]  # x, y [px of the input]

    def to_image(self, xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Boxes (n, 4) [px of the input] in pixels of the image."""
        back: NDArray[np.float64] = (xyxy - np.array(self.shift * 2)) / np.array(self.scale * 2)
        return back.astype(np.float32)


def fit(rgb: NDArray[np.uint8], size: tuple[int, int], resize: str, values: str) -> Fitted:
    """Input of `size` (height, width) for a network, from an image `rgb` (H, W, 3).

    `resize`: "stretch" to the size, "letterbox" (aspect kept, grey below and right), "crop" (the
    centre, after shrinking the shorter side). `values`: "0..255", "0..1" or "imagenet" (mean and
    deviation), and " bgr" behind it where blue comes first.
    """
    height, width = size
    old_height, old_width = rgb.shape[:2]
    if resize == "stretch":
        scale = (width / old_width, height / old_height)
        return Fitted(_tensor(_resized(rgb, width, height), values), scale, (0.0, 0.0))
    ratios = (width / old_width, height / old_height)
    factor = min(ratios) if resize == "letterbox" else max(ratios) * CROP_MARGIN
    small = _resized(rgb, max(round(old_width * factor), 1), max(round(old_height * factor), 1))
    if resize == "letterbox":
        canvas = np.full((height, width, 3), PAD, np.uint8)
        canvas[: small.shape[0], : small.shape[1]] = small
        return Fitted(_tensor(canvas, values), (factor, factor), (0.0, 0.0))
    left, top = (small.shape[1] - width) // 2, (small.shape[0] - height) // 2
    cut = small[top : top + height, left : left + width]
    return Fitted(_tensor(cut, values), (factor, factor), (-float(left), -float(top)))


def _resized(rgb: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    shape = (height, width)
    if rgb.shape[:2] == shape:
        return rgb
    return cv2.resize(rgb, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.uint8)


def _tensor(rgb: NDArray[np.uint8], values: str) -> NDArray[np.float32]:
    pixels = rgb.astype(np.float32)
    scale, _, order = values.partition(" ")
    if scale == "0..1":
        pixels /= 255
    elif scale == "imagenet":
        pixels = (pixels - IMAGENET_MEAN) / IMAGENET_SCALE
    if order == "bgr":
        pixels = pixels[:, :, ::-1]
    return np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])
