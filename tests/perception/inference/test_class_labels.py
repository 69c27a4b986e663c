"""Labels are read with the network, and never guessed where they do not fit."""

import numpy as np
import pytest

from kg.model.errors import ModelError
from perception.inference.class_labels import read_labels
from perception.inference.scene_classifier import load_scene_classifier

THREE = {"probs": np.array([[0.2, 0.3, 0.5]], np.float32)}


@pytest.mark.parametrize(
    "text",
    ['["a", "b", "c"]', "{0: 'a', 1: 'b', 2: 'c'}", '{"1": "b", "0": "a", "2": "c"}', "a,b, c",
     "a\nb\nc\n"],
)  # fmt: skip
def test_labels_in_the_networks_metadata(write_network, text):
    path = write_network(THREE, metadata={"names": text})
    assert load_scene_classifier(path).labels == ("a", "b", "c")


def test_labels_beside_the_network_of_its_name_or_its_size(write_network):
    path = write_network(THREE)
    (path.parent / "labels_two.txt").write_text("x\ny\n")
    (path.parent / "labels_three.txt").write_text("x\ny\nz\n")
    assert load_scene_classifier(path).labels == ("x", "y", "z")
    path.with_suffix(".labels.txt").write_text("a\nb\nc\n")
    assert load_scene_classifier(path).labels == ("a", "b", "c")


def test_given_labels_win(write_network):
    path = write_network(THREE, metadata={"names": "a,b,c"})
    assert load_scene_classifier(path, labels=["p", "q", "r"]).labels == ("p", "q", "r")


def test_eighty_classes_are_cocos_unless_said_otherwise(write_network):
    path = write_network({"probs": np.full((1, 80), 1 / 80, np.float32)})
    labels = load_scene_classifier(path).labels
    assert (labels[0], labels[41], labels[79]) == ("person", "cup", "toothbrush")


def test_labels_that_do_not_fit_are_an_error(write_network):
    path = write_network(THREE)
    with pytest.raises(ModelError, match=r"has 3 classes and no labels: put written\.labels\.txt"):
        load_scene_classifier(path)
    with pytest.raises(ModelError, match="has 3 classes, the given list has 2 labels"):
        load_scene_classifier(path, labels=["a", "b"])
    path.with_suffix(".labels.txt").write_text("a\nb\n")
    with pytest.raises(ModelError, match=r"has 3 classes, written\.labels\.txt has 2 labels"):
        load_scene_classifier(path)
    wrong = write_network(THREE, name="meta.onnx", metadata={"labels": "a,b"})
    with pytest.raises(ModelError, match="its metadata 'labels' has 2 labels"):
        load_scene_classifier(wrong)


def test_the_published_places365_list_is_understood(tmp_path):
    path = tmp_path / "categories.txt"
    path.write_text("/a/airfield 0\n/a/apartment_building/outdoor 8\n/k/kitchen 203")
    assert read_labels(path) == ("airfield", "apartment_building/outdoor", "kitchen")
