"""The scene classifier on photographs of rooms."""

import numpy as np
import pytest

from kg.model.errors import ModelError
from perception.inference.scene_classifier import load_scene_classifier
from perception.sources.folders.image_files import read_colour
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False)


def accuracy(classifier, folder, classes) -> float:
    right = []
    for name in classes:
        for path in sorted((folder / name).glob("*.jpg"))[:10]:
            scores = classifier.classify_image(read_colour(path)).probability
            right.append(max(scores, key=scores.__getitem__) == name)
    assert len(right) == 10 * len(classes)
    return sum(right) / len(right)


def test_rooms_are_recognised_in_photographs(shared):
    classifier = load_scene_classifier()
    assert accuracy(classifier, shared("data/images/places365_val120"), classifier.labels) > 0.75
    rooms = shared("data/images/rooms")
    assert accuracy(classifier, rooms, ["bathroom", "bedroom", "kitchen"]) >= 0.8


def test_the_kitchen_recording_is_a_kitchen(shared):
    classifier = load_scene_classifier()
    recording = open_recording(shared("data/rgbd/redkitchen"), OPTIONS)
    scores = classifier.classify(next(recording.frames(60))).probability
    assert set(scores) == set(classifier.labels)
    assert sum(scores.values()) == pytest.approx(1)
    assert scores["kitchen"] > 0.5


def test_365_places_are_read_with_the_labels_beside_the_network(shared):
    classifier = load_scene_classifier(shared("models/squeezenet11_places365.onnx"))
    assert len(classifier.labels) == 365
    assert accuracy(classifier, shared("data/images/places365_val120"), ["bathroom"]) >= 0.3


def test_features_of_similar_rooms_are_nearer_than_of_others(shared):
    classifier = load_scene_classifier()
    kitchen = open_recording(shared("data/rgbd/redkitchen"), OPTIONS)
    living = open_recording(shared("data/rgbd/icl_livingroom"), OPTIONS)
    a, b, c = (
        features / np.linalg.norm(features)
        for frames in (kitchen.frames(60), kitchen.frames(70), living.frames(30))
        for _, features in (classifier.described(next(frames).rgb),)
    )
    assert a.shape == (1280,)
    assert a @ b > a @ c


def test_a_network_without_features_says_so(shared):
    classifier = load_scene_classifier(shared("models/squeezenet11_places365.onnx"))
    frame = next(open_recording(shared("data/rgbd/redkitchen"), OPTIONS).frames())
    with pytest.raises(ModelError, match="no output 'features'"):
        classifier.described(frame.rgb)


def test_raw_scores_become_probabilities(write_network):
    path = write_network({"logits": np.array([[1.0, 3.0, -2.0]], np.float32)})
    classifier = load_scene_classifier(path, labels=["a", "b", "c"])
    scores = classifier.classify_image(np.zeros((50, 60, 3), np.uint8)).probability
    weights = np.exp([1.0, 3.0, -2.0])
    assert list(scores.values()) == pytest.approx((weights / weights.sum()).tolist())


def test_a_detector_is_no_scene_classifier(write_network):
    with pytest.raises(ModelError, match="is of the kind detector, and a scene is wanted"):
        load_scene_classifier("ssdlite_mobilenet_v2_coco_300")
    boxes = write_network({"boxes": np.zeros((1, 5, 4), np.float32)})
    with pytest.raises(ModelError, match="is no scene classifier"):
        load_scene_classifier(boxes)
