"""Evaluation of scene classifiers on labelled photographs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from kg.model.errors import ModelError
from lab.networks.scene_evaluation import evaluate_scenes
from perception.inference.scene_classifier import load_scene_classifier


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
