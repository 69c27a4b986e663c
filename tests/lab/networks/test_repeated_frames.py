from __future__ import annotations

import numpy as np

from lab.networks.repeated_frames import RememberingSceneClassifier
from perception.frames import Detections, Frame, SceneScores
from perception.inference.detector_pair import RememberingDetector


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
