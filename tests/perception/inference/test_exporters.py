"""Ways of exporting detectors: small networks of constants that answer one cup, read alike.

Each answers as its exporter has it for an image of 640 x 480 with a cup at x 320..420, y 240..300.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto as T
from onnx import helper, numpy_helper

from kg.model.errors import ModelError
from perception.inference.detector import load_detector

CUP, COCO_CUP = 41, 47  # of 80 from 0, and of COCO's 90 ids from 1
BOX = np.array([320, 240, 420, 300], np.float32)
INPUT = 640  # the image is letterboxed at its top left, or stretched by 4/3 down
STRETCHED = BOX * np.array([1, 4 / 3] * 2, np.float32)
SHARES = STRETCHED / INPUT
IMAGE = np.full((480, 640, 3), 90, np.uint8)
RNG = np.random.default_rng(0)


def centred(box: np.ndarray) -> np.ndarray:
    return np.concatenate([(box[:2] + box[2:]) / 2, box[2:] - box[:2]])


def grid_rows(
    n: int,
    objectness: bool,
    classes: int = 80,
    *,
    box: np.ndarray | None = None,
    constant: float = 0,
) -> np.ndarray:
    """(n, 4 + [1] + classes) weak boxes all over the input, and the cup."""
    rows = np.zeros((n, 4 + objectness + classes), np.float32)
    rows[:, :2], rows[:, 2:4] = RNG.uniform(40, 600, (n, 2)), RNG.uniform(5, 60, (n, 2))
    rows[:, 4:] = RNG.uniform(0, 0.05, rows[:, 4:].shape)
    rows[7] = 0
    rows[7, :4] = centred(BOX) if box is None else box
    if objectness:
        rows[:, 4] = constant or rows[:, 4]
        rows[7, 4] = constant or 0.95
    rows[7, 4 + objectness + min(CUP, classes - 1)] = 0.95
    return rows


def corners(rows: np.ndarray) -> np.ndarray:
    """(n, 4) corners of rows of centres and sizes."""
    return np.hstack([rows[:, :2] - rows[:, 2:4] / 2, rows[:, :2] + rows[:, 2:4] / 2])


def raw_yolox() -> np.ndarray:
    """Offsets and logarithms of sizes in strides, as without decoding in the network."""
    rows = np.zeros((8400, 85), np.float32)
    rows[:, :4] = RNG.normal(0, 1, (8400, 4))
    rows[:, 4] = RNG.uniform(0, 0.05, 8400)
    cell = 33 * 80 + 46  # of stride 8
    centre = centred(BOX)
    rows[cell, :4] = [*(centre[:2] / 8 - (46, 33)), *np.log(centre[2:] / 8)]
    rows[cell, 4] = rows[cell, 5 + CUP] = 0.95
    return rows


def queries(classes: int, cup: int) -> np.ndarray:
    """(300, 4 + classes) as Ultralytics' RT-DETR: centre and size as shares, scores."""
    rows = np.zeros((300, 4 + classes), np.float32)
    rows[:, :2], rows[:, 2:4] = RNG.uniform(0.1, 0.9, (300, 2)), RNG.uniform(0.01, 0.1, (300, 2))
    rows[:, 4:] = RNG.uniform(0, 0.05, (300, classes))
    rows[3] = 0
    rows[3, :4], rows[3, 4 + cup] = centred(SHARES), 0.9
    return rows


def padded(first: Any, n: int = 100, kind: Any = np.float32) -> np.ndarray:
    """(1, n, ...) with one row, then zeros, as suppression in the network pads."""
    found = np.zeros((1, n, *np.shape(first)), kind)
    found[0, 0] = first
    return found


def many(value: Any, kind: Any = np.float32) -> np.ndarray:
    return np.array([[value]], kind)


def nms(names: str, label: int = CUP, kind: Any = np.int32, box: np.ndarray = BOX) -> dict:
    """Four outputs of a suppression in the network."""
    count, boxes, scores, labels = names.split()
    return {
        count: np.array([[1]], np.int32),
        boxes: padded(box),
        scores: padded(0.9),
        labels: padded(label, kind=kind),
    }


def ssd(classes: int, cup: int, background: int) -> np.ndarray:
    """(1, 300, classes) of a softmax: the background at all places but the cup's."""
    scores = np.full((1, 300, classes), 0.0005, np.float32)
    scores[..., background] = 0.95
    scores[0, 3, [background, cup]] = 0.05, 0.9
    return scores


Y_FIRST = SHARES[[1, 0, 3, 2]]
LOGITS = np.full((1, 300, 91), -9, np.float32)
LOGITS[0, 3, COCO_CUP] = 3
SSD_BOXES = corners(queries(1, 0)[:, :4])[None]
DETR_BOXES = queries(1, 0)[None, :, :4]
#: exporter -> outputs, and perhaps the input's shape and type, metadata, other inputs
EXPORTERS: dict[str, tuple[dict[str, np.ndarray], dict[str, Any]]] = {
    "Ultralytics YOLOv8": ({"output0": grid_rows(8400, False).T[None]}, {}),
    "Ultralytics YOLOv8, rows": ({"output0": grid_rows(8400, False)[None]}, {}),
    "Ultralytics YOLOv8, two classes": (
        {"output0": grid_rows(8400, False, 2).T[None]},
        {"metadata": {"names": "{0: 'bowl', 1: 'cup'}"}},
    ),
    "Ultralytics YOLO, nms=True": ({"output0": padded([*BOX, 0.9, CUP], 300)}, {}),
    "Ultralytics RT-DETR": ({"output0": queries(80, CUP)[None]}, {}),
    "Ultralytics RT-DETR, two classes": (
        {"output0": queries(2, 1)[None]},
        {"metadata": {"names": "{0: 'bowl', 1: 'cup'}"}},
    ),
    "YOLOv5": ({"output0": grid_rows(25200, True)[None]}, {}),
    "YOLOv5, half floats": ({"output0": grid_rows(25200, True)[None]}, {"kind": T.FLOAT16}),
    "YOLOv5, any size": ({"output0": grid_rows(25200, True)[None]}, {"shapes": ["n", "a", 85]}),
    "YOLOv5, a batch of four": (
        {"output0": np.repeat(grid_rows(25200, True)[None], 4, 0)},
        {"image": (4, 3, INPUT, INPUT)},
    ),
    "YOLOv6": ({"outputs": grid_rows(8400, True, constant=1.0)[None]}, {}),
    "YOLOv7, end to end": (
        {"output": np.array([[0, *BOX, CUP, 0.9]], np.float32)},
        {"shapes": ["n", 7]},
    ),
    "YOLOv7, EfficientNMS": (nms("num_dets det_boxes det_scores det_classes"), {}),
    "YOLOX": ({"output": raw_yolox()[None]}, {}),
    "YOLOX, decoded in the network": ({"output": grid_rows(8400, True)[None]}, {}),
    "YOLO-NAS": (
        {
            "boxes": corners(grid_rows(8400, False))[None],
            "scores": grid_rows(8400, False)[None, :, 4:],
        },
        {"kind": T.UINT8},
    ),
    "YOLO-NAS, batches": (
        nms("graph2_num_predictions graph2_pred_boxes graph2_pred_scores graph2_pred_classes"),
        {},
    ),
    "YOLO-NAS, flat": (
        {"graph2_flat_predictions": np.array([[0, *BOX, 0.9, CUP]], np.float32)},
        {"shapes": ["n", 7]},
    ),
    "RF-DETR": ({"dets": DETR_BOXES, "labels": LOGITS}, {}),
    "RF-DETR, two classes and a column more": (
        {"dets": DETR_BOXES, "labels": LOGITS[..., [0, COCO_CUP, 1]]},
        {"metadata": {"names": "bowl,cup"}},
    ),
    "DETR, two classes and no object": (
        {"logits": LOGITS[..., [0, COCO_CUP, 1]] + np.where(LOGITS.max(2) < 0, 12, 0)[..., None]
         * np.float32([0, 0, 1]), "pred_boxes": DETR_BOXES},
        {"metadata": {"names": "bowl,cup"}},
    ),
    "SSD, background first": (
        {"scores": ssd(81, CUP + 1, 0), "boxes": SSD_BOXES}, {},
    ),
    "SSD, background last": (
        {"boxes": SSD_BOXES, "scores": ssd(3, 1, 2)}, {"metadata": {"names": "bowl,cup"}},
    ),
    "SSD, COCO's ids": ({"boxes": SSD_BOXES, "scores": ssd(91, COCO_CUP, 0)}, {}),
    "EfficientDet of AutoML": (
        {"detections:0": padded([0, *BOX[[1, 0, 3, 2]], 0.9, COCO_CUP])}, {},
    ),
    "D-FINE, DEIM, RT-DETR": (
        {"labels": many(CUP, np.int64), "boxes": BOX[None, None], "scores": many(0.9)},
        {"more": {"orig_target_sizes": ([1, 2], T.INT64)}},
    ),
    "RT-DETR as trained": ({"logits": LOGITS, "pred_boxes": DETR_BOXES}, {}),
    "EfficientDet of TensorFlow's API": (
        nms("num_detections detection_boxes detection_scores detection_classes",
            COCO_CUP, np.float32, Y_FIRST),
        {"image": (1, "h", "w", 3), "kind": T.UINT8},
    ),
    "TorchVision": (
        {"boxes": STRETCHED[None], "labels": np.array([COCO_CUP], np.int64),
         "scores": np.array([0.9], np.float32)},
        {"image": (3, INPUT, INPUT)},
    ),
    "TorchVision, two classes from 1": (
        {"boxes": STRETCHED[None], "labels": np.array([2], np.int64),
         "scores": np.array([0.9], np.float32)},
        {"metadata": {"names": "bowl,cup"}},
    ),
    "OpenMMLab, mmdeploy": (
        {"dets": np.array([[[*BOX, 0.9]]], np.float32), "labels": many(CUP, np.int64)}, {},
    ),
    "OpenMMLab, mmyolo": (nms("num_dets boxes scores labels"), {}),
    "PaddleDetection": (
        {"multiclass_nms3_0.tmp_0": np.array([[CUP, 0.9, *BOX], [3, 0.1, 5, 5, 9, 9]], np.float32),
         "multiclass_nms3_0.tmp_2": np.array([2], np.int32)},
        {"more": {"scale_factor": ([1, 2], T.FLOAT)}, "shapes": ["n", 6]},
    ),
    "DeepStream-Yolo": (
        {"boxes": BOX[None, None], "scores": np.full((1, 1, 1), 0.9, np.float32),
         "classes": np.full((1, 1, 1), CUP, np.float32)}, {},
    ),
    "DeepStream-Yolo, rows": ({"output": padded([*BOX, 0.9, CUP], 8)}, {"shapes": [1, "n", 6]}),
}  # fmt: skip


@pytest.fixture
def exported(tmp_path) -> Callable[..., Path]:
    """Writes a network that answers constants."""

    def write(
        outputs: dict[str, np.ndarray],
        *,
        image: tuple[Any, ...] = (1, 3, INPUT, INPUT),
        kind: int = T.FLOAT,
        metadata: dict[str, str] | None = None,
        more: dict[str, tuple[list[int], int]] | None = None,
        shapes: list[Any] | None = None,
    ) -> Path:
        inputs = [helper.make_tensor_value_info("images", kind, list(image))]
        inputs += [helper.make_tensor_value_info(n, k, s) for n, (s, k) in (more or {}).items()]
        nodes = [helper.make_node("Identity", [f"{name}_"], [name]) for name in outputs]
        constants = [numpy_helper.from_array(np.ascontiguousarray(a), f"{name}_")
                     for name, a in outputs.items()]  # fmt: skip
        answers = [
            helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(a.dtype),
                shapes if shapes and i == 0 else list(a.shape))
            for i, (name, a) in enumerate(outputs.items())
        ]  # fmt: skip
        graph = helper.make_graph(nodes, "g", inputs, answers, constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        helper.set_model_props(model, metadata or {})
        path = tmp_path / "exported.onnx"
        onnx.save(model, path)
        return path

    return write


@pytest.mark.parametrize("exporter", EXPORTERS)
def test_every_exporter_s_cup_is_a_cup_where_it_is(exported, exporter):
    outputs, options = EXPORTERS[exporter]
    found = load_detector(exported(outputs, **options), threshold=0.3).detect_image(IMAGE)
    assert found.label == ("cup",)
    np.testing.assert_allclose(found.xyxy, [BOX], atol=2)


def test_the_first_class_of_a_suppression_in_the_network_is_kept(exported):
    path = exported(nms("num_dets det_boxes det_scores det_classes", 0))
    assert load_detector(path).detect_image(IMAGE).label == ("person",)


def lone(label: int) -> dict[str, np.ndarray]:
    return {"bboxes": STRETCHED[None], "classes": np.array([label], np.int64),
            "confidence": np.array([0.9], np.float32)}  # fmt: skip


def test_what_two_readings_fit_is_refused_with_the_option_that_chooses(exported):
    path = exported(lone(CUP))
    told = r"labels-from-0: cup at .*labels-from-1: skateboard at .*--head list-labels-from-0 or"
    with pytest.raises(ModelError, match=told):
        load_detector(path).detect_image(IMAGE)
    chosen = load_detector(path, head="list-labels-from-0").detect_image(IMAGE)
    assert chosen.label == ("cup",)
    with pytest.raises(ModelError, match="it may have list-labels-from-0, list-labels-from-1"):
        load_detector(path, head="yolov9")


@pytest.mark.parametrize(
    ("label", "name"), [(0, "person"), (12, "parking meter"), (90, "toothbrush")]
)
def test_a_class_that_one_numbering_lacks_decides(exported, label, name):
    assert load_detector(exported(lone(label))).detect_image(IMAGE).label == (name,)


def test_boxes_that_all_lie_outside_the_image_are_told(exported):
    path = exported({"output0": padded([*BOX * 5, 0.9, CUP], 8)})
    with pytest.raises(ModelError, match="lie outside the image"):
        load_detector(path).detect_image(IMAGE)
