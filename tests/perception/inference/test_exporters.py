"""Ways of exporting detectors: the kinds of the benchmark, and single numbers that decide."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.networks_in_the_wild.__main__ import KINDS, Kind, verdict
from benchmarks.networks_in_the_wild.kinds import (
    CUP,
    EFFICIENT,
    Answer,
    Cup,
    corners,
    grid,
    listed,
    nms,
    rows,
)
from benchmarks.networks_in_the_wild.looking import patched, seen_at, write
from kg.model.errors import ModelError
from perception.inference.detector import load_detector

IMAGE, BOX = patched(np.random.default_rng(0).integers(0, 90, (480, 640, 3), np.uint8))
REFUSED = "refused, works with --head "
#: kinds that are not right without a line
TOLD = {
    "Ultralytics YOLOv8, scores before the sigmoid": "refused, to be exported in another way",
    "EfficientDet, rows with labels from 1": "right, with a line",
    "TorchVision SSD, RetinaNet, FCOS": f"{REFUSED}list-labels-from-1",
    "TorchVision, names of one's own": f"{REFUSED}list-labels-from-1",
    "SSD, background first": "right, with a line",
    "SSD, background last": "right, with a line",
    "TensorFlow's API, TFLite's suppression": "refused, to be exported in another way",
    "TensorFlow's combined suppression": f"{REFUSED}list-y-first-labels-from-0",
    "OpenMMLab, mmdeploy": "right, with a line",
    "PaddleDetection, normalised outside": "right, with a line",
    "PaddleDetection, without suppression": "right, with a line",
    "TensorRT EfficientNMS, TensorFlow's names": f"{REFUSED}list-labels-from-0",
    "columns of corners": "refused, to be exported in another way",
    "columns of centre and size, y first": "refused, to be exported in another way",
    "lists from TensorFlow, y first": f"{REFUSED}list-y-first-labels-from-0",
    "ONNX's zoo, classes from 1 to 80": f"{REFUSED}list-labels-from-1-to-80",
    "rows, classes from 1 to 80": f"{REFUSED}rows-labels-from-1-to-80",
    "rows as shares": f"{REFUSED}rows",
    "rows of centre and size": "refused, to be exported in another way",
    "rows of corner and size": "refused, to be exported in another way",
    "rows, percent": "refused, to be exported in another way",
    "lists of centre and size": "refused, to be exported in another way",
}


@pytest.fixture
def exported(tmp_path) -> Callable[..., Path]:
    """Writes a network that looks for the patch of `IMAGE`."""

    def written(answer: Answer, **options: object) -> Path:
        kind, path = Kind(answer=answer, **options), tmp_path / "exported.onnx"
        write(kind, seen_at(kind, IMAGE, BOX), path)
        return path

    return written


@pytest.mark.parametrize("name", KINDS)
def test_every_exporter_s_cup_is_a_cup_where_it_is_or_the_way_is_told(tmp_path, name):
    answer, options = KINDS[name]
    found, _ = verdict(Kind(answer=answer, **options), [IMAGE], tmp_path)
    assert found == TOLD.get(name, "right")


def test_the_first_class_of_a_suppression_in_the_network_is_kept(exported):
    path = exported(nms("num_dets det_boxes det_scores det_classes", 0))
    assert load_detector(path).detect_image(IMAGE).label == ("person",)


def lone(label: int) -> Answer:
    return listed(label, "bboxes", "classes", "confidence")


def test_what_two_readings_fit_is_refused_with_the_option_that_chooses(exported):
    path = exported(lone(CUP))
    told = r"labels-from-0: cup at .*labels-from-1: skateboard at .*--head list-labels-from-0 or"
    with pytest.raises(ModelError, match=told):
        load_detector(path).detect_image(IMAGE)
    chosen = load_detector(path, head="list-labels-from-0").detect_image(IMAGE)
    assert chosen.label == ("cup",)
    with pytest.raises(ModelError, match="it may have list-labels-from-0, list-labels-from-1"):
        load_detector(path, head="yolov9")


@pytest.mark.parametrize(("label", "name"), [(0, "person"), (90, "toothbrush")])
def test_a_class_that_one_numbering_lacks_decides(exported, label, name):
    assert load_detector(exported(lone(label))).detect_image(IMAGE).label == (name,)


def test_a_class_that_coco_s_ids_leave_out_is_of_one_of_the_other_numberings(exported):
    path = exported(lone(12))
    with pytest.raises(ModelError, match=r"from-0: parking meter.*from-1-to-80: stop sign") as told:
        load_detector(path).detect_image(IMAGE)
    assert "--head list-labels-from-1 " not in str(told.value)


def swapped(boxes: np.ndarray) -> np.ndarray:
    return boxes[:, [1, 0, 3, 2]]


def as_corner_and_size(boxes: np.ndarray) -> np.ndarray:
    return np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])


@pytest.mark.parametrize("form", [corners, swapped, as_corner_and_size])
@pytest.mark.parametrize("across", [True, False])
def test_boxes_of_another_form_are_refused_by_the_cells_that_answer_them(exported, form, across):
    def answer(cup: Cup) -> dict[str, np.ndarray]:
        found = grid(8400, cup)
        boxes = found[:, :4] if form is corners else corners(found)
        found = np.hstack([form(boxes), found[:, 4:]])
        return {"output0": found.T[None] if across else found[None]}

    if form is corners and not across:  # which are read
        assert load_detector(exported(answer)).detect_image(IMAGE).label == ("cup",)
        return
    with pytest.raises(ModelError, match="fits none of its readings"):
        load_detector(exported(answer)).detect_image(IMAGE)


def test_channels_last_means_that_y_may_come_first(exported):
    path = exported(lone(CUP), image=(1, "h", "w", 3))
    with pytest.raises(ModelError, match="--head list-y-first-labels-from-0"):
        load_detector(path).detect_image(IMAGE)


def test_a_class_that_no_label_has_is_told_in_a_later_picture(exported):
    path = exported(listed(69, "boxes", "labels", "scores"), image=(3, 640, 640), shapes=("n", 4))
    detector = load_detector(path, head="list-labels-from-1")
    with pytest.raises(ModelError, match="class 69, which list-labels-from-1 has for nothing"):
        detector.detect_image(IMAGE)


def test_boxes_that_all_lie_outside_the_image_are_told(exported):
    def far(cup: Cup) -> dict[str, np.ndarray]:
        return rows("box", "score", "label")(replace(cup, box=cup.box * 5))

    with pytest.raises(ModelError, match="lie outside the image"):
        load_detector(exported(far), head="rows").detect_image(IMAGE)


def test_another_range_of_colours_is_taken_once_and_said(exported, caplog):
    path = exported(nms(EFFICIENT), values="imagenet")
    detector = load_detector(path)
    blank = np.full((480, 640, 3), 90, np.uint8)
    assert not detector.detect_image(blank) and not caplog.records
    for _ in range(2):
        assert detector.detect_image(IMAGE).label == ("cup",)
    assert [one.getMessage() for one in caplog.records] == [
        "exported shows nothing in a picture with colours in its usual range, and something as "
        "'imagenet', which is taken; metadata values in the file would say it"
    ]
    assert detector.values == "imagenet"


def test_a_range_that_the_network_tells_is_not_changed(exported):
    path = exported(nms(EFFICIENT), values="imagenet", metadata={"values": "0..1"})
    assert not load_detector(path).detect_image(IMAGE)
