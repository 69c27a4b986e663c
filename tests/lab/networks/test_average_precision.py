"""Evaluation of networks."""

import contextlib
import io
import json
from pathlib import Path

import cv2
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
from lab.networks.repeated_frames import RememberingSceneClassifier
from lab.networks.scene_evaluation import evaluate_scenes
from perception.frames import Detections, Frame, SceneScores
from perception.inference.detector import load_detector
from perception.inference.detector_pair import RememberingDetector
from perception.inference.scene_classifier import load_scene_classifier

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


def frame(name):
    image = np.zeros((4, 4, 3), np.uint8)
    return Frame(name, image, np.ones((4, 4), np.float32), np.eye(3), np.eye(4), 0.0)


class Counting:
    """Detector and scene classifier that says which of its calls each answer is of."""

    name = "counting"

    def __init__(self):
        self.calls = 0

    def detect(self, frame):
        self.calls += 1
        score = np.full(1, self.calls / 10, np.float32)
        return Detections(np.zeros((1, 4), np.float32), score, (frame.id,))

    def classify(self, frame):
        self.calls += 1
        return SceneScores({frame.id: self.calls / 10})


def test_each_frame_goes_through_the_detector_once():
    counting = Counting()
    detector = RememberingDetector(counting)
    first = [detector.detect(frame(name)) for name in "ab"]
    again = [detector.detect(frame(name)) for name in "ba"]
    assert counting.calls == 2 and detector.name == "counting"
    assert [found.label for found in again] == [("b",), ("a",)]
    assert again[1] is first[0]


def test_each_frame_goes_through_the_scene_classifier_once():
    counting = Counting()
    classifier = RememberingSceneClassifier(counting)
    assert classifier.classify(frame("a")) is classifier.classify(frame("a"))
    assert counting.calls == 1 and classifier.name == "counting"


@pytest.fixture
def classifier(write_network):
    path = write_network({"probs": np.array([[0.7, 0.2, 0.1]], np.float32)})
    return load_scene_classifier(path, labels=["kitchen", "living_room", "hall"])


def images(folder, **of_class):
    for name, number in of_class.items():
        (folder / name).mkdir(parents=True)
        for i in range(number):
            cv2.imwrite(str(folder / name / f"{i}.png"), np.zeros((30, 40, 3), np.uint8))
    return folder


def test_shares_confusion_and_calibration_by_hand(classifier, tmp_path):
    folder = images(tmp_path / "rooms", **{"Living room": 1, "kitchen": 3, "office": 2})
    found = evaluate_scenes(classifier, folder)
    assert (found.images, found.top1, found.top5) == (4, 0.75, 1.0)
    assert found.confusion == {"living_room": {"kitchen": 1}, "kitchen": {"kitchen": 3}}
    assert found.calibration.ece == pytest.approx(0.05)
    assert found.unknown == {"office": 2}


def test_the_bundled_classifier_knows_four_of_five_photographs(shared):
    found = evaluate_scenes(load_scene_classifier(), shared("data/images/places365_val120"))
    assert found.images == 120
    assert found.top1 > 0.82  # by the centre crop; stretched photographs give 0.81
    assert found.top5 > 0.98


@pytest.mark.parametrize("name", ["absent", "empty"])
def test_folders_without_known_images_say_what_would_work(classifier, tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelError, match="a folder"):
        evaluate_scenes(classifier, tmp_path / name)
