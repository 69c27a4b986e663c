"""Find objects in a frame with an ONNX network of one of three interfaces.

set prediction  `images` [N, 3, H, W] and `orig_target_sizes` [N, 2] (width, height) -> `labels`,
                `boxes` (xyxy in image pixels), `scores`: exports of RT-DETR, D-FINE and DEIM
boxes + scores  one image input [1, 3, H, W] -> `boxes` [1, N, 4] (xyxy in input pixels) and
                `scores` [1, N, C]; suppression of overlapping boxes is done here
YOLOX head      one image input [1, 3, H, W] -> one output [1, N, 5 + C], decoded (yolox.py)

A network without a card gets stretched images in 0..1 for the first interface, letterboxed ones in
0..255 for the second, and the same in BGR for the third.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.errors import ModelError
from perception.frames import Detections, Frame
from perception.inference.class_labels import labels_for
from perception.inference.model_zoo import resolve
from perception.inference.preprocessing import fit
from perception.inference.session import Session
from perception.inference.yolox_head import BOX, cells, decode

OVERLAP = 0.6  # IoU above which the weaker of two boxes of one class is dropped
MOST_DETECTIONS = 100  # an image, as COCO's evaluation counts

SET_PREDICTION = "set prediction"
BOXES_AND_SCORES = "boxes and scores"
YOLOX_HEAD = "YOLOX head"
#: resize and values of images for a network without a card
IMAGES_AS = {
    SET_PREDICTION: ("stretch", "0..1"),
    BOXES_AND_SCORES: ("letterbox", "0..255"),
    YOLOX_HEAD: ("letterbox", "0..255 bgr"),
}

_Boxes = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]


@dataclass(frozen=True, slots=True)
class OnnxDetector:
    """A detector that runs an ONNX network."""

    name: str
    session: Session
    labels: tuple[str, ...]
    interface: str  # one of IMAGES_AS
    image_input: str
    resize: str
    values: str
    threshold: float  # least score, 0..1

    def detect(self, frame: Frame) -> Detections:
        """All objects of `frame` with a score above the threshold, best first."""
        return self.detect_image(frame.rgb)

    def detect_image(self, rgb: NDArray[np.uint8]) -> Detections:
        """All objects of an image (H, W, 3) with a score above the threshold, best first."""
        xyxy, score, label = (
            self._predict(rgb) if self.interface == SET_PREDICTION else self._dense(rgb)
        )
        height, width = rgb.shape[:2]
        xyxy = np.clip(xyxy, 0, np.array([width, height, width, height], np.float32))
        real = np.isfinite(xyxy).all(1) & (xyxy[:, 2] > xyxy[:, 0]) & (xyxy[:, 3] > xyxy[:, 1])
        order = np.argsort(-score[real], kind="stable")[:MOST_DETECTIONS]
        return Detections(
            xyxy[real][order].astype(np.float32),
            score[real][order].astype(np.float32),
            tuple(self._label(int(i)) for i in label[real][order]),
        )

    def _predict(self, rgb: NDArray[np.uint8]) -> _Boxes:
        size = self.session.image_size(self.image_input)
        tensor = fit(rgb, size, self.resize, self.values).tensor
        original = np.array([[rgb.shape[1], rgb.shape[0]]], np.int64)
        labels, boxes, scores = self.session.run(
            ("labels", "boxes", "scores"), {self.image_input: tensor, "orig_target_sizes": original}
        )
        self._refuse_unequal(boxes[0], scores[0], labels[0])
        good = scores[0] > self.threshold
        return (
            boxes[0][good].astype(np.float32),
            scores[0][good].astype(np.float32),
            labels[0][good].astype(np.int64),
        )

    def _dense(self, rgb: NDArray[np.uint8]) -> _Boxes:
        size = self.session.image_size(self.image_input)
        fitted = fit(rgb, size, self.resize, self.values)
        boxes, scores = self._boxes_and_scores(fitted.tensor, size)
        label = scores.argmax(1)
        best = scores.max(1)
        # a box that is not finite would suppress every other: nan compares as overlapping
        good = (best > self.threshold) & np.isfinite(boxes).all(1)
        xyxy, best, label = fitted.to_image(boxes[good]), best[good], label[good]
        kept = suppress(xyxy, best, label)
        return xyxy[kept], best[kept], label[kept].astype(np.int64)

    def _boxes_and_scores(
        self, tensor: NDArray[np.float32], size: tuple[int, int]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Boxes (n, 4) xyxy [px of the input] and scores (n, C), not suppressed yet."""
        inputs = {self.image_input: tensor}
        if self.interface == YOLOX_HEAD:
            raw = self.session.run(tuple(self.session.outputs), inputs)[0][0]
            return decode(raw.astype(np.float32), *size)
        boxes, scores = self.session.run(("boxes", "scores"), inputs)
        self._refuse_unequal(boxes[0], scores[0])
        return boxes[0].astype(np.float32), scores[0].astype(np.float32)

    def _refuse_unequal(self, boxes: NDArray[Any], *others: NDArray[Any]) -> None:
        """Raises ModelError where an output has not one row for each box (n, 4)."""
        shapes = [boxes.shape, *(other.shape for other in others)]
        if boxes.ndim != 2 or any(not s or s[0] != len(boxes) for s in shapes) or shapes[0][1] != 4:
            raise ModelError(
                f"{self.name} gives outputs of shapes {', '.join(map(str, shapes))}; "
                "boxes (n, 4) and as many scores and labels would work"
            )

    def _label(self, index: int) -> str:
        if 0 <= index < len(self.labels):
            return self.labels[index]
        raise ModelError(
            f"{self.session.path.name} answered class {index}, its {len(self.labels)} labels "
            "end before: give the labels it was trained with"
        )


def suppress(
    xyxy: NDArray[np.float32], score: NDArray[np.float32], label: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Indices of the boxes (n, 4) that no better box of their class overlaps, best first."""
    order = np.argsort(-score, kind="stable")
    area = (xyxy[:, 2] - xyxy[:, 0]) * (xyxy[:, 3] - xyxy[:, 1])
    kept: list[int] = []
    while len(order):
        first, rest = order[0], order[1:]
        kept.append(int(first))
        low = np.maximum(xyxy[first, :2], xyxy[rest, :2])
        high = np.minimum(xyxy[first, 2:], xyxy[rest, 2:])
        shared = np.clip(high - low, 0, None).prod(1)
        union = np.maximum(area[first] + area[rest] - shared, 1e-9)
        order = rest[(shared / union <= OVERLAP) | (label[rest] != label[first])]
    return np.array(kept, np.int64)


def load_detector(
    name_or_path: str | Path = "default",
    *,
    threshold: float = 0.25,
    labels: Sequence[str] | Path | None = None,
    threads: int | None = None,
) -> OnnxDetector:
    """Open a detector: "default", a known name (see perception.inference.model_zoo), or an ONNX
    file.

    `labels` (a list, or a file with one a line) override what the network or its card says.
    Raises ModelError for anything that is no detector of a known interface.
    """
    if not 0 <= threshold < 1:
        raise ModelError(f"a score threshold lies in 0..1, got {threshold}")
    path, card = resolve(name_or_path, "detector")
    session = Session(path, threads)
    interface, image_input, classes = _interface(session)
    session.image_size(image_input)
    resize, values = (card.resize, card.values) if card is not None else IMAGES_AS[interface]
    return OnnxDetector(
        name=card.name if card is not None else path.stem,
        session=session,
        labels=labels_for(path, classes, given=labels, metadata=session.metadata, card=card),
        interface=interface,
        image_input=image_input,
        resize=resize,
        values=values,
        threshold=threshold,
    )


def _interface(session: Session) -> tuple[str, str, int | None]:
    """(interface, image input, number of classes if it says); raises ModelError for another one."""
    inputs, outputs = session.inputs, session.outputs
    first = next(iter(inputs))
    if set(inputs) == {"images", "orig_target_sizes"} and {"labels", "boxes", "scores"} <= set(
        outputs
    ):
        return SET_PREDICTION, "images", None
    if len(inputs) == 1 and {"boxes", "scores"} <= set(outputs):
        boxes, scores = outputs["boxes"], outputs["scores"]
        if len(boxes) == len(scores) == 3 and boxes[2] == 4 and isinstance(scores[2], int):
            return BOXES_AND_SCORES, first, scores[2]
    if len(inputs) == len(outputs) == 1:
        shape = next(iter(outputs.values()))
        known = len(shape) == 3 and isinstance(shape[1], int) and isinstance(shape[2], int)
        if known and shape[1] == cells(*session.image_size(first)) and shape[2] > BOX:
            return YOLOX_HEAD, first, shape[2] - BOX
    raise ModelError(
        f"{session.path.name} is no detector of a known interface ({session.interface()}); known: "
        "images, orig_target_sizes -> labels, boxes, scores; image -> boxes [1, N, 4], "
        "scores [1, N, C]; image -> YOLOX head [1, N, 5 + C]"
    )
