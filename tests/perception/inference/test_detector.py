"""Detectors: what they find in the real kitchen, and what happens around the network."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.errors import ModelError
from perception.frames import Detections
from perception.inference.detector import load_detector
from perception.inference.heads.candidates import suppress
from perception.sources.folders.image_files import read_colour


def iou(a: np.ndarray, b: np.ndarray) -> float:
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    shared = np.clip(high - low, 0, None).prod()
    return float(shared / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - shared))


@pytest.fixture
def annotated(shared):
    """(image, [(class, box)]) of the eight frames of the kitchen with hand-made boxes."""
    folder = shared("data/rgbd/redkitchen")
    boxes: dict[int, list] = {}
    for thing in json.loads((folder / "objects_gt.json").read_text())["objects"].values():
        for entry in thing["boxes"]:
            boxes.setdefault(entry["frame"], []).append(
                (thing["cls"], np.array(entry["box"], float))
            )
    return [(read_colour(folder / f"frame-{n:06d}.color.jpg"), b) for n, b in boxes.items()]


def recall(detector, annotated, least_score: float) -> float:
    hits = [
        any(
            label == wanted and score > least_score and iou(box, truth) >= 0.4
            for box, score, label in zip(found.xyxy, found.score, found.label, strict=True)
        )
        for rgb, boxes in annotated
        for found in [detector.detect_image(rgb)]
        for wanted, truth in boxes
    ]
    assert len(hits) == 42
    return sum(hits) / len(hits)


@pytest.mark.parametrize(
    ("network", "at_25", "at_50"),
    [
        ("default", 0.40, 0.21),
        ("models/deimv2_femto_416.onnx", 0.81, 0.60),
        ("models/nanodet_plus_m_416.onnx", 0.67, 0.40),
        ("models/yolox_nano_416.onnx", 0.62, 0.40),
        ("models/nanodet_g_416.onnx", 0.64, 0.17),
    ],
)
def test_detectors_find_what_is_in_the_kitchen(shared, annotated, network, at_25, at_50):
    detector = load_detector(network if network == "default" else shared(network))
    assert recall(detector, annotated, 0.25) == pytest.approx(at_25, abs=0.03)
    assert recall(detector, annotated, 0.5) == pytest.approx(at_50, abs=0.03)


def test_detections_are_sorted_inside_the_image_and_above_the_threshold(shared):
    rgb = read_colour(shared("data/rgbd/redkitchen/frame-000240.color.jpg"))
    found = load_detector(shared("models/deimv2_femto_416.onnx"), threshold=0.4).detect_image(rgb)
    assert len(found) > 3
    assert found.score.min() > 0.4
    assert (np.diff(found.score) <= 0).all()
    assert found.xyxy.min() >= 0
    assert (found.xyxy.max(0) <= [640, 480, 640, 480]).all()


def test_a_portrait_image_gives_boxes_in_its_own_pixels(shared):
    rgb = read_colour(shared("data/rgbd/redkitchen/frame-000240.color.jpg"))
    cut = np.ascontiguousarray(rgb[:, 150:450])
    for network in ("deimv2_femto_416", "nanodet_plus_m_416"):
        found = load_detector(shared(f"models/{network}.onnx")).detect_image(cut)
        cup = np.array([213 - 150, 303, 263 - 150, 355])
        assert (
            max(
                iou(box, cup)
                for box, label in zip(found.xyxy, found.label, strict=True)
                if label == "cup"
            )
            > 0.5
        )


def dense(boxes, scores) -> dict[str, np.ndarray]:
    return {"boxes": np.array([boxes], np.float32), "scores": np.array([scores], np.float32)}


LABELS = ("cup", "chair")
IMAGE = np.zeros((100, 200, 3), np.uint8)


def run(path, **options) -> Detections:
    return load_detector(path, labels=LABELS, **options).detect_image(IMAGE)


def test_letterboxed_boxes_come_back_in_image_pixels(write_network):
    # a 200x100 image in a 100x100 input is halved
    found = run(write_network(dense([[10, 5, 40, 45]], [[0.9, 0.1]])))
    np.testing.assert_allclose(found.xyxy, [[20, 10, 80, 90]])
    assert found.label == ("cup",)


def test_overlapping_boxes_of_one_class_are_one_object_of_two_classes_two(write_network):
    boxes = [[10, 5, 40, 45], [11, 5, 41, 45], [10, 6, 40, 45], [60, 5, 90, 45]]
    scores = [[0.8, 0], [0.9, 0], [0, 0.7], [0.6, 0]]
    found = run(write_network(dense(boxes, scores)))
    assert found.label == ("cup", "chair", "cup")
    assert found.score.tolist() == pytest.approx([0.9, 0.7, 0.6])


def test_boxes_that_are_no_boxes_are_dropped(write_network):
    boxes = [[np.nan, 5, 40, 45], [40, 5, 10, 45], [-90, 5, -10, 45], [10, 5, 40, 90]]
    found = run(write_network(dense(boxes, [[0.9, 0]] * 4)))
    np.testing.assert_allclose(found.xyxy, [[20, 10, 80, 100]])


def test_nothing_found_is_an_empty_answer(write_network):
    found = run(write_network(dense([[10, 5, 40, 45]], [[0.1, 0.1]])))
    assert len(found) == 0
    assert found.xyxy.shape == (0, 4)


def set_prediction(label: int) -> dict[str, object]:
    outputs = {
        "labels": np.array([[label]], np.int64),
        "boxes": np.array([[[20, 10, 80, 90]]], np.float32),
        "scores": np.array([[0.9]], np.float32),
    }
    inputs = {"images": (("N", 3, 64, 64), 1), "orig_target_sizes": (("N", 2), 7)}
    return {"outputs": outputs, "inputs": inputs}


def test_set_prediction_boxes_are_taken_as_they_are(write_network):
    found = run(write_network(**set_prediction(1)))
    np.testing.assert_allclose(found.xyxy, [[20, 10, 80, 90]])
    assert found.label == ("chair",)


def test_a_yolox_head_is_decoded_cell_by_cell(write_network):
    # a 64x64 input has grids of 8x8, 4x4 and 2x2 cells
    raw = np.zeros((1, 84, 7), np.float32)
    raw[..., :2] = 0.5  # the middle of each cell
    raw[0, 8 * 1 + 2] = [0.5, 0.25, np.log(2), np.log(1), 0.9, 0.1, 0.8]
    raw[0, 64 + 16 + 3] = [0.0, 0.0, np.log(1), np.log(1), 0.5, 0.9, 0.0]
    path = write_network({"output": raw}, inputs={"images": ((1, 3, 64, 64), 1)})
    found = load_detector(path, labels=LABELS).detect_image(np.zeros((128, 128, 3), np.uint8))
    assert found.label == ("chair", "cup")
    assert found.score.tolist() == pytest.approx([0.72, 0.45])
    # input px: centre (20, 10), size 16x8; centre (32, 32), size 32x32; the image is twice as large
    np.testing.assert_allclose(found.xyxy, [[24, 12, 56, 28], [32, 32, 96, 96]], rtol=1e-5)


def test_a_class_beyond_the_labels_is_an_error(write_network):
    with pytest.raises(ModelError, match=r"answered class 7, its 2 labels"):
        run(write_network(**set_prediction(7)))


def test_networks_of_another_interface_are_told_the_known_ones(write_network):
    raw = write_network({"output": np.zeros((1, 3598, 112), np.float32)})
    with pytest.raises(ModelError, match=r"known: images, orig_target_sizes"):
        load_detector(raw)
    flat = write_network(dense([[1, 2, 3, 4]], [[1, 0]]), inputs={"x": ((1, 300), 1)})
    with pytest.raises(ModelError, match=r"must be \[N, 3, H, W\]"):
        load_detector(flat, labels=LABELS)
    whole = write_network(dense([[1, 2, 3, 4]], [[1, 0]]), inputs={"x": ((1, 3, 9, 9), 7)})
    with pytest.raises(ModelError, match="must be float32"):
        load_detector(whole, labels=LABELS)


def test_a_scene_network_is_no_detector():
    with pytest.raises(ModelError, match="is of the kind scene, and a detector is wanted"):
        load_detector("rooms6_efficientnet_lite0_224")


def test_files_that_are_no_network(tmp_path):
    with pytest.raises(ModelError, match="no network file"):
        load_detector(tmp_path / "absent.onnx")
    broken = tmp_path / "broken.onnx"
    for content in (b"", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n"):
        broken.write_bytes(content)
        with pytest.raises(ModelError, match="is no ONNX network") as caught:
            load_detector(broken)
        assert "\n" not in str(caught.value)


def test_unknown_names_are_told_the_known_ones():
    with pytest.raises(ModelError, match="did you mean deimv2_femto"):
        load_detector("deimv2_fento_coco")


@pytest.mark.parametrize("threshold", [-0.1, 1.0, 25])
def test_thresholds_lie_between_zero_and_one(threshold):
    with pytest.raises(ModelError, match="threshold"):
        load_detector(threshold=threshold)


def test_threads_are_set_from_the_environment(monkeypatch):
    monkeypatch.setenv("HEREABOUTS_THREADS", "none")
    with pytest.raises(ModelError, match="HEREABOUTS_THREADS"):
        load_detector()


corner = st.floats(0, 90)
side = st.floats(1, 50)


@given(st.lists(st.tuples(corner, corner, side, side, st.floats(0.01, 1), st.integers(0, 1))))
def test_suppression_keeps_the_best_and_separates_what_it_keeps(rows):
    xyxy = np.array([[x, y, x + w, y + h] for x, y, w, h, _, _ in rows], np.float32).reshape(-1, 4)
    score = np.array([row[4] for row in rows], np.float32)
    label = np.array([row[5] for row in rows], np.int64)
    kept = suppress(xyxy, score, label, overlap=0.6, max_count=100)
    for c in set(label.tolist()):
        of_class = [i for i in kept if label[i] == c]
        assert score[of_class].max() == score[label == c].max()
        for i, a in enumerate(of_class):
            assert all(iou(xyxy[a], xyxy[b]) <= 0.601 for b in of_class[:i])


@pytest.mark.parametrize(
    ("boxes", "scores"),
    [([[0, 0, 9, 9], [1, 1, 5, 5]], [[0.9, 0.1]]), ([[0, 0, 9, 9]], [[0.9, 0.1], [0.8, 0.2]])],
)
def test_outputs_that_do_not_belong_together_are_an_error(write_network, boxes, scores):
    with pytest.raises(ModelError, match="shapes"):
        run(write_network(dense(boxes, scores)))


def test_scores_of_percent_are_refused_and_sums_of_shares_are_not(write_network) -> None:
    boxes = [[10, 5, 40, 45]]
    with pytest.raises(ModelError, match=r"scores up to 93 are no shares of 1"):
        run(write_network(dense(boxes, [[93.0, 2.0]])))
    found = run(write_network(dense(boxes, [[1.04, 0.0]])))
    assert found.score.tolist() == [1.0]
