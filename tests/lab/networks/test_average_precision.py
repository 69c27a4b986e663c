"""Average precision: equal to pycocotools, on made-up and on real detections."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from kg.model.errors import ModelError
from lab.networks.average_precision import AveragePrecision
from lab.networks.coco_dataset import TrueBoxes, load_coco
from lab.networks.detector_evaluation import THRESHOLD, evaluate_detector
from perception.inference.detector import load_detector

CATEGORIES = {3: "cup", 7: "chair"}
side = st.integers(0, 150)


def box(corner: tuple[int, int, int, int]) -> list[int]:
    x, y, width, height = corner
    return [x, y, width + 1, height + 1]


boxes = st.tuples(side, side, side, side).map(box)
kinds = st.sampled_from(sorted(CATEGORIES))
truths = st.lists(st.tuples(boxes, kinds, st.booleans()), max_size=5)
# few scores, so that there are equals; boxes of the truth, so that there are hits
finds = st.lists(st.tuples(st.integers(0, 4), boxes, kinds, st.integers(1, 5)), max_size=8)


def pycocotools(data: dict, found: list[dict]) -> list[float]:
    """AP, AP50, AP75, AP of small, medium and large, AR."""
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO()
        truth.dataset = data
        truth.createIndex()
        one = COCOeval(truth, truth.loadRes(found), "bbox")
        one.evaluate()
        one.accumulate()
        one.summarize()
    return [*one.stats[:6], one.stats[8]]


@settings(max_examples=60)
@given(st.lists(st.tuples(truths, finds), min_size=1, max_size=3))
def test_scores_are_those_of_pycocotools(images):
    data = {"info": {}, "images": [], "annotations": [], "categories": []}
    data["categories"] = [{"id": k, "name": name} for k, name in CATEGORIES.items()]
    results, ours = [], AveragePrecision(CATEGORIES)
    for number, (true, found) in enumerate(images):
        data["images"].append({"id": number, "width": 400, "height": 400})
        rows = [(corners, kind, score) for at, corners, kind, score in found]
        for i, (at, _, kind, score) in enumerate(found):
            if at < len(true):
                rows[i] = (true[at][0], kind, score)
        for corners, kind, crowd in true:
            data["annotations"].append(
                {
                    "id": len(data["annotations"]) + 1,  # pycocotools takes 0 for no match
                    "image_id": number,
                    "category_id": kind,
                    "bbox": corners,
                    "area": corners[2] * corners[3] * 0.7,
                    "iscrowd": int(crowd),
                }
            )
        for corners, kind, score in rows:
            results.append(
                {"image_id": number, "category_id": kind, "bbox": corners, "score": score / 5}
            )
        ours.add(
            xyxy([corners for corners, _, _ in rows]),
            np.array([score / 5 for _, _, score in rows]),
            np.array([kind for _, kind, _ in rows], int),
            TrueBoxes(
                xyxy([corners for corners, _, _ in true]),
                np.array([kind for _, kind, _ in true], int),
                np.array([corners[2] * corners[3] * 0.7 for corners, _, _ in true]),
                np.array([crowd for _, _, crowd in true], bool),
            ),
        )
    scores = ours.scores()
    if not results:
        return
    found = (scores.ap, scores.ap50, scores.ap75)
    found += (scores.ap_small, scores.ap_medium, scores.ap_large, scores.ar)
    # pycocotools has -1 where there is nothing to be found
    assert [-1 if x is None else x for x in found] == pytest.approx(pycocotools(data, results))


def xyxy(rows: list[list[int]]) -> np.ndarray:
    table = np.array(rows, float).reshape(-1, 4)
    return np.concatenate([table[:, :2], table[:, :2] + table[:, 2:]], axis=1)


def test_a_real_detector_scores_as_pycocotools_says(shared, tmp_path):
    dataset = load_coco(shared("data/images/coco"))
    detector = load_detector(shared("models/deimv2_femto_416.onnx"), threshold=THRESHOLD)
    results = tmp_path / "results.json"
    scores = evaluate_detector(detector, dataset, results=results).scores
    expected = pycocotools(json.loads(dataset.path.read_text()), json.loads(results.read_text()))
    found = (scores.ap, scores.ap50, scores.ap75)
    found += (scores.ap_small, scores.ap_medium, scores.ap_large, scores.ar)
    assert found == pytest.approx(expected, abs=1e-6)
    assert scores.ap > 0.3 and scores.images == 21
    assert sum(one.true for one in scores.classes) == scores.true


def write(folder: Path, **changed: object) -> Path:
    data = {
        "images": [{"id": 1, "file_name": "a.jpg"}],
        "categories": [{"id": 1, "name": "cup"}],
        "annotations": [{"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]}],
    }
    (folder / "images").mkdir(exist_ok=True)
    (folder / "images" / "a.jpg").write_bytes(b"no image")
    (folder / "instances.json").write_text(json.dumps(data | changed))
    return folder


def test_a_data_set_is_read(tmp_path):
    (image,) = load_coco(write(tmp_path))
    assert image.path == tmp_path / "images" / "a.jpg"
    np.testing.assert_allclose(image.truth.xyxy, [[1, 2, 4, 6]])
    assert image.truth.area.tolist() == [12]


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"images": 3}, "holds no COCO annotations"),
        ({"images": []}, "lists no images|holds no COCO"),
        ({"annotations": [{"image_id": 9, "category_id": 1, "bbox": [1, 2, 3, 4]}]}, "KeyError: 9"),
        ({"annotations": [{"image_id": 1, "category_id": 2, "bbox": [1, 2, 3, 4]}]}, "category 2"),
        ({"annotations": [{"image_id": 1, "category_id": 1, "bbox": [1, 2, -3, 4]}]}, "box"),
        ({"annotations": [{"image_id": 1, "category_id": 1, "bbox": [1, 2, 1e999, 4]}]}, "box"),
        ({"images": [{"id": 1, "file_name": "../a.jpg"}]}, "outside the data set"),
        ({"images": [{"id": 1, "file_name": "b.jpg"}]}, "no image 'b.jpg'"),
    ],
)
def test_annotations_that_are_none_are_one_line(tmp_path, changed, told):
    with pytest.raises(ModelError, match=told) as caught:
        load_coco(write(tmp_path, **changed))
    assert "\n" not in str(caught.value)


def test_a_folder_without_annotations_says_what_would_work(tmp_path):
    with pytest.raises(ModelError, match=r"a folder with instances\.json"):
        load_coco(tmp_path)


def test_a_detector_of_other_classes_is_refused(tmp_path):
    other = write(tmp_path, categories=[{"id": 1, "name": "gizmo"}])
    with pytest.raises(ModelError, match="share no class: it has person, bicycle"):
        evaluate_detector(load_detector(), load_coco(other))
