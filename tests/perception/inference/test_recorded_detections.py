import json
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import ModelError
from perception.frames import Detections, Frame
from perception.inference.recorded_detections import (
    load_recorded_detections,
    open_detector,
    save_recorded_detections,
)


def frame(name: str) -> Frame:
    K = np.array([[70.0, 0, 39.5], [0, 70.0, 29.5], [0, 0, 1]])
    depth = np.ones((60, 80), np.float32)
    return Frame(name, np.zeros((60, 80, 3), np.uint8), depth, K, np.eye(4), 0.0)


def written(tmp_path: Path, rows: object) -> Path:
    path = tmp_path / "found.json"
    path.write_text(json.dumps({"name": "mine", "frames": {"a": rows, "b": []}}))
    return path


def test_boxes_come_back_best_first_and_above_the_threshold(tmp_path: Path) -> None:
    rows = [[1, 2, 30, 40, 0.3, "cup"], [5, 6, 7, 8, 0.9, "chair"], [0, 0, 9, 9, 0.6, "cup"]]
    detector = open_detector(written(tmp_path, rows), threshold=0.5)
    assert detector.name == "mine"
    found = detector.detect(frame("a"))
    assert found.label == ("chair", "cup")
    assert found.xyxy[0].tolist() == [5, 6, 7, 8]
    assert len(detector.detect(frame("b"))) == 0


def test_what_is_saved_is_loaded_again(tmp_path: Path) -> None:
    boxes = np.array([[1.5, 2.5, 30.5, 40.5], [1, 1, 2, 2]], np.float32)
    found = Detections(boxes, np.array([0.75, 0.5], np.float32), ("potted plant", 'a "label"'))
    save_recorded_detections(tmp_path / "found.json", "mine", {"a": found})
    again = load_recorded_detections(tmp_path / "found.json").detect(frame("a"))
    assert np.array_equal(again.xyxy, found.xyxy) and again.label == found.label
    assert np.allclose(again.score, found.score)


def test_boxes_narrower_than_what_is_written_stay_boxes(tmp_path: Path) -> None:
    boxes = np.array([[10.01, 5, 10.04, 20], [7.22, 3.51, 60.18, 3.54]], np.float32)
    found = Detections(boxes, np.array([0.9, 0.6], np.float32), ("cup", "book"))
    save_recorded_detections(tmp_path / "found.json", "mine", {"a": found})
    again = load_recorded_detections(tmp_path / "found.json").detect(frame("a"))
    assert np.array_equal(again.xyxy, boxes)


def test_what_is_saved_exactly_is_the_same_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    corners = rng.uniform(0, 60, (20, 2))
    boxes = np.hstack([corners, corners + rng.uniform(0.01, 9, (20, 2))]).astype(np.float32)
    scores = np.sort(rng.uniform(0, 1, 20))[::-1].astype(np.float32)
    found = Detections(boxes, scores, ("cup",) * 20)
    save_recorded_detections(tmp_path / "found.json", "mine", {"a": found}, exact=True)
    again = load_recorded_detections(tmp_path / "found.json").detect(frame("a"))
    assert np.array_equal(again.xyxy, boxes) and np.array_equal(again.score, scores)


def test_a_frame_that_is_not_listed_is_an_error(tmp_path: Path) -> None:
    detector = load_recorded_detections(written(tmp_path, []))
    with pytest.raises(ModelError, match="has no frame 'c'; an entry for each frame"):
        detector.detect(frame("c"))


@pytest.mark.parametrize(
    "rows",
    [
        [[1, 2, 3]],
        [[1, 2, 30, 40, 0.5, 7]],
        [[9, 2, 3, 40, 0.5, "cup"]],
        [[1, 2, 30, 40, 1.5, "cup"]],
        [["x", 2, 3, 40, 0.5, "cup"]],
        [[1, 2, 30, 40, float("nan"), "cup"]],
        7,
        {"box": 1},
    ],
)
def test_rows_that_are_no_boxes_are_refused(tmp_path: Path, rows: object) -> None:
    with pytest.raises(ModelError, match=r"frame 'a'.*label\] would work"):
        load_recorded_detections(written(tmp_path, rows))


@pytest.mark.parametrize("text", ["", "[]", '{"frames": 3}', "{", "[" * 100000])
def test_files_that_hold_no_detections_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "found.json"
    path.write_text(text)
    with pytest.raises(ModelError, match="detections"):
        load_recorded_detections(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="cannot read detections"):
        open_detector(tmp_path / "absent.json")


def test_masks_are_saved_and_loaded_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    masks = (rng.random((38, 29)) > 0.7, None, np.ones((2, 2), bool))
    boxes = np.array([[1.53, 2.54, 30.56, 40.1], [1, 1, 2, 2], [4, 4, 5.02, 5.07]], np.float32)
    found = Detections(
        boxes, np.array([0.7, 0.6, 0.5], np.float32), ("cup", "cup", "chair"), mask=masks
    )
    save_recorded_detections(tmp_path / "found.json", "mine", {"a": found})
    again = load_recorded_detections(tmp_path / "found.json", threshold=0.55).detect(frame("a"))
    assert np.array_equal(again.xyxy, boxes[:2])
    assert np.array_equal(again.mask[0], masks[0]) and again.mask[1] is None


@pytest.mark.parametrize(
    "mask",
    [
        {"size": [2, 2], "runs": [1, 2]},
        {"size": [2, 2], "runs": [5, -1]},
        {"size": [10**9, 10**9], "runs": [10**18]},
        {"size": [2, 2], "runs": "?"},
        {"size": [2], "runs": [2]},
        {"runs": [4]},
        7,
    ],
)
def test_masks_that_are_none_are_one_line(tmp_path: Path, mask: object) -> None:
    with pytest.raises(ModelError, match="frame 'a'") as caught:
        load_recorded_detections(written(tmp_path, [[1, 2, 30, 40, 0.5, "cup", mask]]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["default", "a.json"])
def test_a_head_is_refused_where_no_outputs_have_one(name):
    with pytest.raises(ModelError, match=r"--detector FILE\.onnx would work"):
        open_detector(name, head="yolov8")
