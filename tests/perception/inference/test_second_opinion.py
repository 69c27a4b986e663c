import shutil

import numpy as np
import pytest

from perception.inference.class_labels import NO_OBJECT, coco_by_id
from perception.inference.detector import load_detector
from perception.inference.second_opinion import SecondOpinion
from perception.sources.folders.image_files import read_colour

COCO = [one for one in coco_by_id() if one != NO_OBJECT]
SHIFTED = [*COCO[1:], COCO[0]]
BY_ID = [one if one != NO_OBJECT else "zebra" for one in coco_by_id()]


@pytest.fixture(scope="module")
def pictures(shared):
    kitchen = sorted(shared("data/rgbd/redkitchen").glob("*.color.jpg"))[::12]
    return [read_colour(path) for path in kitchen]


@pytest.mark.parametrize(
    ("labels", "told"), [(COCO, ""), (SHIFTED, "as classes from 1")], ids=["right", "one off"]
)
def test_labels_that_a_network_counts_otherwise_are_told(
    shared, tmp_path, pictures, caplog, labels, told
):
    shutil.copy(shared("models/yolox_nano_416.onnx"), tmp_path / "somebodys.onnx")
    detector = load_detector(tmp_path / "somebodys.onnx", threshold=0.4, labels=labels)
    for rgb in pictures:
        detector.detect_image(rgb)
    assert (told in caplog.text) if told else not caplog.text


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda xyxy, label: (xyxy, label), ""),
        (lambda xyxy, label: (xyxy[:, [1, 0, 3, 2]], label), "with y first"),
        (lambda xyxy, label: (xyxy, BY_ID[COCO.index(label)]), "as classes from 0"),
        (lambda xyxy, label: (xyxy, COCO[min(coco_by_id().index(label), 79)]), "as COCO's ids"),
    ],
    ids=["right", "y first", "classes from 0", "COCO's ids"],
)
def test_answers_in_another_order_are_told_by_what_the_bundled_network_sees(
    pictures, caplog, changed, told
):
    detector = load_detector("nanodet_g_416", threshold=0.4)
    opinion = SecondOpinion("somebodys", COCO, lambda: load_detector().detect_image)
    for rgb in pictures:
        found = detector.detect_image(rgb)
        both = [changed(found.xyxy, one) for one in found.label]
        xyxy = both[0][0] if both else found.xyxy
        size = np.array([*rgb.shape[1::-1]] * 2, np.float32)
        label = tuple(one for _, one in both)
        opinion.compare(rgb, type(found)(np.minimum(xyxy, size), found.score, label))
    assert (told in caplog.text) if told else not caplog.text
    assert not told or "--head" in caplog.text


def test_networks_with_labels_of_their_own_are_not_compared(pictures):
    def never():
        raise AssertionError("the bundled network is not needed")

    opinion = SecondOpinion("somebodys", ("cup", "my bowl"), never)
    opinion.compare(pictures[0], load_detector(threshold=0.2).detect_image(pictures[0]))


def test_where_the_bundled_network_is_missing_nothing_is_compared(pictures, caplog):
    asked = []

    def missing():
        asked.append(True)
        return load_detector("no such network")

    opinion = SecondOpinion("somebodys", COCO, missing)
    found = [load_detector(threshold=0.4).detect_image(rgb) for rgb in pictures]
    for rgb, one in zip(pictures, found, strict=True):
        opinion.compare(rgb, one)
    assert (asked, caplog.text) == ([True], "")
