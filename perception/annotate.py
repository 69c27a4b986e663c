"""Annotation: boxes and scene scores drawn on frames, and small pictures of single things.

Pictures of things are JPEG, with people made unrecognisable.
"""

from __future__ import annotations

import colorsys
import zlib
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.frames import Detections, Frame, SceneScores

FONT = cv2.FONT_HERSHEY_SIMPLEX
DESIGN_HEIGHT = 480  # [px] image height the sizes below are meant for
FONT_SCALE = 0.45
PADDING = 4  # [px]
SCENES_SHOWN = 3
PANEL_SHADE = 0.4  # brightness left behind the scene scores

_Colour = tuple[int, int, int]
Image = NDArray[np.uint8]  # (H, W, 3)
Boxes = NDArray[np.float32]  # (n, 4) xyxy [px]


def draw_detections(
    frame: Frame, detections: Detections, scene: SceneScores | None = None
) -> NDArray[np.uint8]:
    """Annotated image (H, W, 3) RGB: boxes, labels with scores, likeliest scenes.

    The weakest box is drawn first, so that the best stay readable. A label keeps its colour from
    picture to picture.
    """
    picture = np.ascontiguousarray(frame.rgb.copy())
    size = max(frame.rgb.shape[0] / DESIGN_HEIGHT, 0.5)
    for i in reversed(range(len(detections))):
        box = [round(float(x)) for x in detections.xyxy[i]]
        text = f"{detections.label[i]} {detections.score[i]:.2f}"
        _draw_box(picture, box, text, label_colour(detections.label[i]), size)
    if scene is not None and scene.probability:
        _draw_scene(picture, scene, size)
    return picture


def label_colour(label: str) -> _Colour:
    """A bright RGB colour that belongs to `label`, the same on every machine."""
    hue = zlib.crc32(label.encode()) % 360 / 360
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.75, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


def decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    """Image (H, W, 3) of what `encode_jpeg` gave."""
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return np.ascontiguousarray(np.asarray(bgr, np.uint8)[:, :, ::-1])


def encode_jpeg(rgb: NDArray[np.uint8], quality: int = 80) -> bytes:
    """An RGB image (H, W, 3) as JPEG; `quality` from 1 to 100."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    encoded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not encoded:
        raise RecordingError(f"an image of {rgb.shape} cannot be encoded as JPEG")
    return data.tobytes()


def save_image(path: Path | str, rgb: NDArray[np.uint8]) -> None:
    """Write an RGB image (H, W, 3); the suffix (.jpg, .png) sets the format.

    Raises RecordingError where it cannot be written.
    """
    path = Path(path)
    try:
        encoded, data = cv2.imencode(path.suffix or ".png", np.ascontiguousarray(rgb[:, :, ::-1]))
    except cv2.error as error:
        raise RecordingError(
            f"cannot write {path}: no picture format {path.suffix!r}; .jpg and .png work"
        ) from error
    if not encoded:
        raise RecordingError(f"cannot write {path}: the picture cannot be encoded")
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error


def _draw_box(
    picture: NDArray[np.uint8], box: list[int], text: str, colour: _Colour, size: float
) -> None:
    cv2.rectangle(picture, box[:2], box[2:], colour, max(1, round(2 * size)))
    width, height = _text_size(text, size)
    left = min(max(box[0], 0), max(0, picture.shape[1] - width))
    above = box[1] - height
    top = above if above >= 0 else min(box[1], picture.shape[0] - height)
    cv2.rectangle(picture, (left, top), (left + width, top + height), colour, cv2.FILLED)
    brightness = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    ink = (0, 0, 0) if brightness > 128 else (255, 255, 255)
    _write(picture, text, left, top + height, ink, size)


def _draw_scene(picture: NDArray[np.uint8], scene: SceneScores, size: float) -> None:
    """A shaded panel in the lower left corner with a bar for each of the likeliest places."""
    ranked = sorted(scene.probability.items(), key=lambda item: (-item[1], item[0]))[:SCENES_SHOWN]
    lines = [(f"{label.replace('_', ' ')} {share:.2f}", share) for label, share in ranked]
    line = _text_size("x", size)[1]
    width = min(max(_text_size(text, size)[0] for text, _ in lines), picture.shape[1])
    top = picture.shape[0] - line * len(lines)
    panel = picture[max(top, 0) :, :width]
    panel[:] = (panel * PANEL_SHADE).astype(np.uint8)
    for i, (text, share) in enumerate(lines):
        y = top + i * line
        end = (round(width * share), y + line - 1)
        cv2.rectangle(picture, (0, y), end, (70, 110, 160), cv2.FILLED)
        _write(picture, text, 0, y + line, (255, 255, 255), size)


def _text_size(text: str, size: float) -> tuple[int, int]:
    """Width and height [px] of a line of text with its padding."""
    (width, height), base = cv2.getTextSize(text, FONT, FONT_SCALE * size, 1)
    pad = round(PADDING * size)
    return width + 2 * pad, height + base + pad


def _write(
    picture: NDArray[np.uint8], text: str, left: int, bottom: int, ink: _Colour, size: float
) -> None:
    pad = round(PADDING * size)
    base = cv2.getTextSize(text, FONT, FONT_SCALE * size, 1)[1]
    origin = (left + pad, bottom - base)
    cv2.putText(picture, text, origin, FONT, FONT_SCALE * size, ink, 1, cv2.LINE_AA)


MAX_SIDE: Final = 160  # [px] side of a picture of a thing, ...
VIEW_SIDE: Final = 256  # ... and of a view
_MARGIN: Final = 0.15  # of the box, shown around it
_BLOCKS: Final = 6  # that people are coarsened to, along each side of their part of a picture


def object_picture(
    rgb: NDArray[np.uint8],
    box: tuple[float, float, float, float],
    people: NDArray[np.float32],
    max_bytes: int,
    *,
    side: int = MAX_SIDE,
) -> bytes | None:
    """JPEG of `box` (xyxy [px]) in an image (H, W, 3), with a margin, of `max_bytes` at most.

    Its longer side is `side` [px], or less where the box is small.

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
    scale = min(side / max(picture.shape[:2]), 2.0)
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
