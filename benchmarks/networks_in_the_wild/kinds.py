"""Ways of exporting detectors: what each answers where it sees a cup."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from onnx import TensorProto as T

from perception.inference.class_labels import UNUSED_IDS

Array = NDArray[Any]

CUP, COCO_CUP = 41, 47  # of 80 from 0, and of COCO's 90 ids from 1
COCO_IDS: Final = sorted({*range(1, 91)} - {*UNUSED_IDS})
NAMES: Final = {"names": "{0: 'bowl', 1: 'cup'}"}
BYTES: Final = {"kind": T.UINT8, "values": "0..255"}
CHANNELS_LAST: Final = {"image": (1, "h", "w", 3)}
SIZES: Final = {"more": {"orig_target_sizes": ([1, 2], T.INT64)}}


@dataclass(frozen=True, slots=True)
class Cup:
    """A cup as a network sees it."""

    box: Array  # xyxy [px of the input]
    score: float
    size: tuple[int, int]  # width, height of the input

    @property
    def shares(self) -> Array:
        """The box as shares of the input."""
        return self.box / np.array(self.size * 2)

    @property
    def logit(self) -> float:
        """The score before the sigmoid."""
        return float(np.log(self.score / (1 - self.score)))


Answer = Callable[[Cup], dict[str, Array]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A way of exporting."""

    answer: Answer
    image: tuple[Any, ...] = (1, 3, 640, 640)
    values: str = "0..1"  # that the network looks for
    resize: str = "letterbox"
    kind: int = T.FLOAT
    metadata: dict[str, str] = field(default_factory=dict)
    more: dict[str, tuple[list[int], int]] = field(default_factory=dict)  # inputs
    shapes: tuple[Any, ...] = ()  # that the first output declares

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of its input."""
        sides = [one for one in self.image[-3:] if one != 3]
        height, width = (one if isinstance(one, int) else 640 for one in sides)
        return height, width


def centred(box: Array) -> Array:
    """Centre and size of corners."""
    return np.concatenate([(box[:2] + box[2:]) / 2, box[2:] - box[:2]])


def corners(rows: Array) -> Array:
    """(n, 4) corners of rows of centres and sizes."""
    return np.hstack([rows[:, :2] - rows[:, 2:4] / 2, rows[:, :2] + rows[:, 2:4] / 2])


def places(n: int, cup: Cup) -> Array:
    """(n, 2) places that answer: of cells of three sizes, one or three times, else anywhere."""
    width, height = cup.size
    found = list[Array]()
    for stride in (8, 16, 32):
        row, column = np.mgrid[: height // stride, : width // stride]
        found.append((np.stack([column.ravel(), row.ravel()], 1) + 0.5) * stride)
    for anchors in (1, 3):
        if anchors * sum(map(len, found)) == n:
            return np.concatenate([np.tile(one, (anchors, 1)) for one in found])
    return np.random.default_rng(1).uniform(0.06, 0.94, (n, 2)) * cup.size


def grid(
    n: int, cup: Cup, *, sure: float | None = None, classes: int = 80, label: int = CUP
) -> Array:
    """(n, 4 + [1] + classes) weak boxes all over the input, the cup, and two boxes beside it.

    `sure` is the objectness of all: 0 has the network's own, None no column of it.
    """
    rng, first = np.random.default_rng(0), 4 + (sure is not None)
    rows = np.zeros((n, first + classes))
    rows[:, :2] = places(n, cup) + rng.uniform(-5, 5, (n, 2))
    rows[:, 2:4] = rng.uniform(0.01, 0.1, (n, 2)) * cup.size
    rows[:, 4:] = rng.uniform(0, 0.05, rows[:, 4:].shape)
    for place, share in ((7, 1.0), (9, 0.8), (n // 2, 0.7)):
        rows[place] = 0
        rows[place, :4] = centred(cup.box) + (1 - share) * np.array([9, 6, -9, 9])
        rows[place, first + label] = share * cup.score
    if sure is not None:
        rows[:, 4] = sure or rows[:, first:].max(axis=1) ** 0.5
        rows[:, first:] /= rows[:, 4:5]
    return rows


def yolox(cup: Cup) -> Array:
    """Offsets and logarithms of sizes in strides, as without decoding in the network."""
    rng = np.random.default_rng(0)
    rows = np.zeros((8400, 85))
    rows[:, :4], rows[:, 4] = rng.normal(0, 1, (8400, 4)), rng.uniform(0, 0.05, 8400)
    centre = centred(cup.box)
    rows[33 * 80 + 46, :4] = [*(centre[:2] / 8 - (46, 33)), *np.log(centre[2:] / 8)]
    rows[33 * 80 + 46, [4, 5 + CUP]] = 1, cup.score
    return rows


def shared(rows: Array, cup: Cup) -> Array:
    """Rows whose boxes are shares of the input."""
    return np.hstack([rows[..., :4] / np.array(cup.size * 2), rows[..., 4:]])


def queries(cup: Cup, classes: int = 80, label: int = CUP) -> Array:
    """(1, 300, 4 + classes) of a transformer, a box for each thing."""
    rows = shared(grid(300, cup, classes=classes, label=label), cup)
    rows[[9, 150], 4:] = 0.01
    return rows[None]


def logits(cup: Cup, classes: int, label: int) -> Array:
    """(1, 300, classes) before a sigmoid."""
    found = np.full((1, 300, classes), -6.0)
    found[0, 7, label] = cup.logit
    return found


def softmax(cup: Cup, classes: int, label: int, background: int) -> Array:
    """(1, 300, classes) after a softmax: the background at all places but the cup's."""
    found = np.full((1, 300, classes), 0.0005)
    found[..., background] = 0.95
    found[0, 7, [background, label]] = 0.95 - cup.score, cup.score
    return found


def padded(first: Any, n: int = 100, kind: Any = float) -> Array:
    """(1, n, ...) with one row, then zeros, as suppression in the network pads."""
    found = np.zeros((1, n, *np.shape(first)), kind)
    found[0, 0] = first
    return found


def listed(label: int = CUP, *order: str, shares: bool = False, y_first: bool = False) -> Answer:
    """Boxes (n, 4), scores and labels (n,) of one thing, by names in the order of their outputs."""

    def answer(cup: Cup) -> dict[str, Array]:
        box = (cup.shares if shares else cup.box)[[1, 0, 3, 2] if y_first else [0, 1, 2, 3]]
        found = (box[None], np.array([label]), np.array([cup.score]))
        parts = dict(zip(("box", "label", "score"), found, strict=True))
        return {one: parts[_part(one)] for one in order}

    return answer


def nms(
    names: str, label: int = CUP, kind: Any = np.int32, form: Callable[[Cup], Array] | None = None
) -> Answer:
    """Four outputs of a suppression in the network: padded, and their number."""

    def answer(cup: Cup) -> dict[str, Array]:
        parts = {
            "box": padded(cup.box if form is None else form(cup)),
            "score": padded(cup.score),
            "label": padded(label, kind=kind),
            "num": np.array([[1]], np.int32),
        }
        return {one: parts[_part(one)] for one in names.split()}

    return answer


def _part(name: str) -> str:
    words = {
        "num": r"num|valid",
        "score": r"score|conf|6383",
        "label": r"label|class|6381",
        "box": r"box|det|6379",
    }
    return next(part for part, word in words.items() if re.search(word, name))


def rows(
    *columns: str, n: int = 300, label: int = CUP, weak: Sequence[int] = (), shares: bool = False
) -> Answer:
    """[1, n, K] finished rows of `columns`, padded by zeros or weak boxes of labels `weak`."""

    def answer(cup: Cup) -> dict[str, Array]:
        box = cup.shares if shares else cup.box
        forms = {
            "box": box,
            "centre": centred(box),
            "corner_size": np.concatenate([box[:2], box[2:] - box[:2]]),
            "score": cup.score,
            "percent": 100 * cup.score,
            "label": label,
            "batch": 0,
        }
        found = padded(np.hstack([forms[one] for one in columns]), n)
        if weak:
            labels = np.random.default_rng(0).choice(weak, n)[1:, None]
            found[0, 1:] = np.hstack([corners(grid(n, cup))[1:], labels * 0 + 0.02, labels])
        return {"output": found}

    return answer


def one(name: str, make: Callable[[Cup], Array]) -> Answer:
    """One output."""
    return lambda cup: {name: make(cup)}


def y_shares(cup: Cup) -> Array:
    """The box as shares, y first."""
    return cup.shares[[1, 0, 3, 2]]


def segments(cup: Cup, *, suppressed: bool) -> dict[str, Array]:
    """Boxes with coefficients of prototypes of masks."""
    masks = np.full((1, 32, 160, 160), -1.0)
    if suppressed:
        found = padded([*cup.box, cup.score, CUP, *np.eye(32)[0]], 300)
    else:
        found = np.hstack([grid(8400, cup), np.tile(np.eye(32)[0], (8400, 1))]).T[None]
    return {"output0": found, "output1": masks}


def of_labels(cup: Cup, classes: int, label: int) -> dict[str, Array]:
    """RF-DETR's two outputs."""
    return {"dets": queries(cup)[..., :4], "labels": logits(cup, classes, label)}


def detr(cup: Cup) -> dict[str, Array]:
    """DETR's two outputs: a softmax of two classes and none."""
    found = np.zeros((1, 300, 3))
    found[..., 2] = 8
    found[0, 7] = -9, cup.logit, 0
    return {"logits": found, "pred_boxes": queries(cup)[..., :4]}


def set_prediction(cup: Cup) -> dict[str, Array]:
    """Labels, boxes in the image's pixels and scores."""
    return {"labels": padded(CUP, 300, np.int64), "boxes": padded(cup.box, 300),
            "scores": padded(cup.score, 300)}  # fmt: skip


def ssd(classes: int, label: int, background: int) -> Answer:
    """Boxes as shares and a softmax over classes and background."""
    return lambda cup: {
        "scores": softmax(cup, classes, label, background),
        "boxes": corners(queries(cup)[0, :, :4])[None],
    }


def paddle(cup: Cup) -> dict[str, Array]:
    """Rows of class, score and box, and their number."""
    found = np.array([[CUP, cup.score, *cup.box], [3, 0.1, 5, 5, 9, 9]])
    return {"multiclass_nms3_0.tmp_0": found, "multiclass_nms3_0.tmp_2": np.array([2], np.int32)}


EFFICIENT, TENSORFLOW = "num_dets det_boxes det_scores det_classes", (
    "detection_boxes detection_classes detection_scores num_detections")  # fmt: skip
STRETCH: Final[dict[str, Any]] = {"resize": "stretch"}
VISION: Final[dict[str, Any]] = {"image": (3, 640, 640), **STRETCH, "shapes": ("n", 4)}
NORMALISED: Final[dict[str, Any]] = {"values": "imagenet", **STRETCH}
BGR: Final[dict[str, Any]] = {"values": "0..255 bgr"}
SCALE: Final[dict[str, Any]] = {"more": {"scale_factor": ([1, 2], T.FLOAT)}, "shapes": ("n", 6)}
#: exporter -> its answer, and what else it has
KINDS: Final[dict[str, tuple[Answer, dict[str, Any]]]] = {
    "Ultralytics YOLOv5": (one("output0", lambda c: grid(25200, c, sure=0)[None]), {}),
    "Ultralytics YOLOv5, one class": (
        one("output0", lambda c: grid(25200, c, sure=0, classes=1, label=0)[None]),
        {"metadata": {"names": "{0: 'cup'}"}}),
    "Ultralytics YOLOv5, half floats": (
        one("output0", lambda c: grid(25200, c, sure=0)[None]), {"kind": T.FLOAT16}),
    "Ultralytics YOLOv5, any size": (
        one("output0", lambda c: grid(25200, c, sure=0)[None]), {"shapes": ("n", "a", 85)}),
    "Ultralytics YOLOv5, a batch of four": (
        one("output0", lambda c: np.repeat(grid(25200, c, sure=0)[None], 4, 0)),
        {"image": (4, 3, 640, 640)}),
    "Ultralytics YOLOv5, from TensorFlow": (
        one("output0", lambda c: shared(grid(25200, c, sure=0), c)[None]), CHANNELS_LAST),
    "Ultralytics YOLOv8": (one("output0", lambda c: grid(8400, c).T[None]), {}),
    "Ultralytics YOLOv8, two classes": (
        one("output0", lambda c: grid(8400, c, classes=2, label=1).T[None]), {"metadata": NAMES}),
    "Ultralytics YOLOv8, 320 x 512": (
        one("output0", lambda c: grid(3360, c).T[None]), {"image": (1, 3, 320, 512)}),
    "Ultralytics YOLOv8, any size": (
        one("output0", lambda c: grid(8400, c).T[None]),
        {"image": ("n", 3, "h", "w"), "shapes": ("n", 84, "a")}),
    "Ultralytics YOLOv8, rows": (one("output0", lambda c: grid(8400, c)[None]), {}),
    "Ultralytics YOLOv8, from TensorFlow": (
        one("output0", lambda c: shared(grid(8400, c), c).T[None]), CHANNELS_LAST),
    "Ultralytics YOLOv8, scores before the sigmoid": (
        one("output0", lambda c: np.vstack([
            grid(8400, c)[:, :4].T, np.log(grid(8400, c)[:, 4:] + 1e-6).T + 3])[None]), {}),
    "Ultralytics, nms=True": (rows("box", "score", "label"), {"metadata": NAMES | {
        "names": repr({i: f"a{i}" if i != CUP else "cup" for i in range(80)})}}),
    "Ultralytics YOLOv8-seg": (lambda c: segments(c, suppressed=False), {}),
    "Ultralytics YOLOv8-seg, nms=True": (lambda c: segments(c, suppressed=True), {}),
    "Ultralytics YOLOv10, without labels": (
        rows("box", "score", "label", weak=range(80)), {}),
    "Ultralytics RT-DETR": (one("output0", queries), STRETCH),
    "Ultralytics RT-DETR, two classes": (
        one("output0", lambda c: queries(c, 2, 1)), {**STRETCH, "metadata": NAMES}),
    "YOLOv6": (one("outputs", lambda c: grid(8400, c, sure=1.0)[None]), {}),
    "YOLOv7, end to end": (
        one("output", lambda c: np.array([[0, *c.box, CUP, c.score]])), {"shapes": ("n", 7)}),
    "YOLOv7, EfficientNMS": (nms(EFFICIENT), {}),
    "YOLOX": (one("output", lambda c: yolox(c)[None]), BGR),
    "YOLOX, decoded in the network": (one("output", lambda c: grid(8400, c, sure=0)[None]), BGR),
    "YOLO-NAS": (
        lambda c: {"boxes": corners(grid(8400, c))[None], "scores": grid(8400, c)[None, :, 4:]},
        BYTES),
    "YOLO-NAS, batches": (nms("graph2_num_predictions graph2_pred_boxes graph2_pred_scores "
                              "graph2_pred_classes"), BYTES),
    "YOLO-NAS, flat": (
        one("graph2_flat_predictions", lambda c: np.array([[0, *c.box, c.score, CUP]])),
        {**BYTES, "shapes": ("n", 7)}),
    "RF-DETR": (lambda c: of_labels(c, 91, COCO_CUP), NORMALISED),
    "RF-DETR, two classes and a column more": (
        lambda c: of_labels(c, 3, 1), {**NORMALISED, "metadata": NAMES}),
    "DETR, two classes and no object": (detr, {**NORMALISED, "metadata": NAMES}),
    "D-FINE, DEIM, RT-DETR": (set_prediction, {**SIZES, **STRETCH}),
    "D-FINE, DEIM, RT-DETR, two classes": (
        lambda c: set_prediction(c) | {"labels": padded(1, 300, np.int64)},
        {**SIZES, **STRETCH, "metadata": NAMES}),
    "RT-DETR as trained": (
        lambda c: {"logits": logits(c, 80, CUP), "pred_boxes": queries(c)[..., :4]}, STRETCH),
    "EfficientDet of AutoML": (
        one("detections:0", lambda c: padded([0, *c.box[[1, 0, 3, 2]], c.score, COCO_CUP])),
        {**CHANNELS_LAST, **BYTES}),
    "EfficientDet, rows with labels from 1": (
        rows("box", "score", "label", n=100, label=COCO_CUP, weak=COCO_IDS),
        {"values": "imagenet"}),
    "TorchVision Faster R-CNN": (listed(COCO_CUP, "boxes", "labels", "scores"), VISION),
    "TorchVision SSD, RetinaNet, FCOS": (listed(COCO_CUP, "boxes", "scores", "labels"), VISION),
    "TorchVision, names of one's own": (
        listed(COCO_CUP, "bboxes", "confidence", "classes"), VISION),
    "TorchVision, two classes from 1": (
        listed(2, "boxes", "labels", "scores"), {**VISION, "metadata": NAMES}),
    "SSD, background first": (ssd(81, CUP + 1, 0), NORMALISED),
    "SSD, background last": (ssd(3, 1, 2), {**NORMALISED, "metadata": NAMES}),
    "SSD, COCO's ids": (ssd(91, COCO_CUP, 0), NORMALISED),
    "TensorFlow's API": (
        nms(TENSORFLOW, COCO_CUP, float, y_shares), {**CHANNELS_LAST, **BYTES, **STRETCH}),
    "TensorFlow's API, TFLite's suppression": (
        lambda c: {f"TFLite_Detection_PostProcess{i}": one for i, one in zip(
            ("", ":1", ":2", ":3"), nms("box label score num", COCO_CUP - 1, float, y_shares)(
                c).values(), strict=True)}, {**CHANNELS_LAST, **BYTES, **STRETCH}),
    "TensorFlow's combined suppression": (
        nms("nmsed_boxes nmsed_scores nmsed_classes valid_detections", CUP, float, y_shares),
        {**CHANNELS_LAST, **STRETCH}),
    "OpenMMLab, mmdeploy": (
        lambda c: {"dets": padded([*c.box, c.score]), "labels": padded(CUP, kind=np.int64)},
        {"values": "imagenet"}),
    "OpenMMLab, mmyolo": (nms("num_dets boxes scores labels"), {}),
    "PaddleDetection": (paddle, {**SCALE, **STRETCH}),
    "PaddleDetection, normalised outside": (paddle, {**SCALE, **NORMALISED}),
    "PaddleDetection, without suppression": (
        lambda c: {"boxes": corners(grid(8400, c))[None], "scores": grid(8400, c)[:, 4:].T[None]},
        STRETCH),
    "TensorRT EfficientNMS, TensorFlow's names": (nms(
        "num_detections detection_boxes detection_scores detection_classes"), {}),
    "TensorRT BatchedNMS": (nms("num_detections nmsed_boxes nmsed_scores nmsed_classes", CUP, float,
                                lambda c: c.shares), {}),
    "DeepStream-Yolo, three outputs": (
        lambda c: {"boxes": c.box[None, None], "scores": np.full((1, 1, 1), c.score),
                   "classes": np.full((1, 1, 1), CUP, float)}, {}),
    "DeepStream-Yolo, rows": (rows("box", "score", "label", n=8), {"shapes": (1, "n", 6)}),
    "columns of corners": (one("output0", lambda c: np.vstack([
        corners(grid(8400, c)).T, grid(8400, c)[:, 4:].T])[None]), {}),
    "columns of centre and size, y first": (
        one("output0", lambda c: grid(8400, c)[:, [1, 0, 3, 2, *range(4, 84)]].T[None]), {}),
    "lists from TensorFlow, y first": (nms("num boxes classes scores", CUP, float, y_shares),
                                       {**CHANNELS_LAST, **BYTES, **STRETCH}),
    "ONNX's zoo, classes from 1 to 80": (listed(CUP + 1, "6379", "6381", "6383"), VISION),
    "rows, classes from 1 to 80": (rows("box", "score", "label", label=CUP + 1), {}),
    "rows as shares": (
        rows("box", "score", "label", shares=True), {"metadata": {"resize": "stretch"}, **STRETCH}),
    "rows, class first": (rows("label", "score", "box"), {}),
    "rows of centre and size": (rows("centre", "score", "label"), {}),
    "rows of corner and size": (rows("corner_size", "score", "label"), {}),
    "rows, percent": (rows("box", "percent", "label"), {}),
    "lists of centre and size": (nms(EFFICIENT, form=lambda c: centred(c.box)), {}),
    "colours that its metadata tell": (
        nms(EFFICIENT), {"values": "imagenet bgr", "metadata": {"values": "imagenet bgr"}}),
}  # fmt: skip
