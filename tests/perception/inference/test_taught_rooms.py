"""Rooms taught on the spot, measured on photographs that were not shown."""

import io

import numpy as np
import pytest

from kg.model.errors import ModelError
from lab.networks.scene_evaluation import labelled_images
from perception.frames import SceneScores
from perception.inference.scene_classifier import (
    FILE,
    MAX_EXAMPLES,
    RoomExamples,
    TaughtSceneClassifier,
    load_scene_classifier,
    room_examples,
)
from perception.sources.folders.image_files import read_colour

FOLDS = 5


@pytest.fixture(scope="module")
def photographs(shared) -> list[tuple[str, np.ndarray]]:
    folder = shared("data/images/places365_val120")
    return [(name, read_colour(path)) for name, path in labelled_images(folder)]


def accuracy(network, photographs, taught_labels, described) -> float:
    """Top-1 on five folds, each taught by the others: 16 images a room."""
    right = []
    for fold in range(FOLDS):
        shown = [i for i in range(len(photographs)) if i % FOLDS != fold]
        shown = [i for i in shown if photographs[i][0] in taught_labels]
        examples = RoomExamples(
            network.name,
            np.stack([described[i][1] for i in shown]),
            np.array([list(described[i][0].probability.values()) for i in shown], np.float32),
            tuple(photographs[i][0] for i in shown),
            ("place",) * len(shown),
        )
        taught = TaughtSceneClassifier(network, examples)
        for i in range(fold, len(photographs), FOLDS):
            name, rgb = photographs[i]
            scores = taught.classify_image(rgb).probability
            assert sum(scores.values()) == pytest.approx(1)
            right.append(max(scores, key=scores.__getitem__) == name)
    return sum(right) / len(right)


class Remembering:
    """The bundled network, which looks at each photograph once."""

    def __init__(self) -> None:
        self.network = load_scene_classifier()
        self.name, self.device = self.network.name, self.network.device
        self.labels = self.network.labels
        self._seen: dict[int, tuple[SceneScores, np.ndarray]] = {}

    def described(self, rgb):
        if id(rgb) not in self._seen:
            self._seen[id(rgb)] = self.network.described(rgb)
        return self._seen[id(rgb)]


@pytest.fixture(scope="module")
def network() -> Remembering:
    return Remembering()


class Unaware:
    """The network without one of its kinds of rooms: kitchens are to it something else."""

    def __init__(self, network: Remembering) -> None:
        self.network = network
        self.name, self.device = self.network.name, self.network.device
        self.labels = tuple(label for label in self.network.labels if label != "kitchen")

    def described(self, rgb):
        scores, features = self.network.described(rgb)
        rest = {label: scores.probability[label] for label in self.labels}
        return SceneScores({k: p / sum(rest.values()) for k, p in rest.items()}), features


def test_rooms_that_were_taught_are_told_apart(network, photographs):
    described = [network.described(rgb) for _, rgb in photographs]
    found = accuracy(network, photographs, network.labels, described)
    assert found >= 0.83  # 0.75 is asked for; the network alone has 0.83


def test_a_room_that_the_network_does_not_know_is_learnt(network, photographs):
    network = Unaware(network)
    described = [network.described(rgb) for _, rgb in photographs]
    own = [max(s.probability, key=s.probability.__getitem__) for s, _ in described]
    before = np.mean([a == name for a, (name, _) in zip(own, photographs, strict=True)])
    after = accuracy(network, photographs, network.network.labels, described)
    assert after >= 0.75 and after > before + 0.05


class Bright:
    """A network whose features are nearly the same of all images; their brightness shows a bit."""

    name, device, labels = "bright", "cpu", ("kitchen", "bedroom")

    def described(self, rgb):
        features = np.array([100.0, 100.0 + np.sign(rgb.mean() - 100.0)], np.float32)
        return SceneScores(dict.fromkeys(self.labels, 0.5)), features


def test_what_all_images_have_in_common_tells_no_room_from_another():
    images = [np.full((4, 4, 3), value, np.uint8) for value in (200, 50)]
    both = room_examples(Bright(), images[:1] * 8, label="kitchen", place="p1").with_place(
        room_examples(Bright(), images[1:] * 8, label="bedroom", place="p2")
    )
    taught = TaughtSceneClassifier(Bright(), both)
    light, dark = (taught.classify_image(rgb).probability for rgb in images)
    assert light["kitchen"] > 0.7 and dark["bedroom"] > 0.7


def test_one_kind_of_room_changes_little_and_files_come_back(photographs, tmp_path):
    network = load_scene_classifier()
    kitchens = [rgb for name, rgb in photographs if name == "kitchen"][:4]
    examples = room_examples(network, kitchens, label="kitchen", place="p1")
    taught = TaughtSceneClassifier(network, examples)
    for _, rgb in photographs[::30]:
        own, now = (c.classify_image(rgb).probability for c in (network, taught))
        assert now == pytest.approx(own, abs=0.01)
    examples.save(tmp_path)
    again = RoomExamples.load(tmp_path)
    assert again.label == examples.label
    np.testing.assert_allclose(again.features, examples.features, rtol=1e-3, atol=1e-6)


def examples(place: str, label: str, n: int = 2, network: str = "net") -> RoomExamples:
    features = np.full((n, 3), len(label), np.float32)
    return RoomExamples(network, features, np.ones((n, 2), np.float32), (label,) * n, (place,) * n)


def test_a_place_that_is_taught_again_forgets_what_it_was_taught_by():
    both = examples("a", "kitchen").with_place(examples("b", "bedroom"))
    assert both.label == ("kitchen",) * 2 + ("bedroom",) * 2
    again = both.with_place(examples("a", "bathroom", 1))
    assert again.label == ("bedroom", "bedroom", "bathroom")
    with pytest.raises(ModelError, match="taught to net"):
        both.with_place(examples("c", "hall", network="other"))


@pytest.mark.parametrize("content", ["empty", "text", "pickle", "shapes", "nan", "cut", "bits"])
def test_damaged_files_are_one_line(tmp_path, content):
    arrays = {"network": np.array("net"), "features": np.zeros((2, 3))}
    arrays |= {"probability": np.zeros((2, 2)), "label": np.array(["a", "b"])}
    arrays["place"] = np.array(["p"] if content == "shapes" else ["p", "q"])
    if content == "pickle":
        arrays["label"] = np.array([{}, []], object)
    if content == "nan":
        arrays["features"] = np.full((2, 3), np.nan)
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    data = {"empty": b"", "text": b"rooms", "cut": packed.getvalue()[:300]}
    data["bits"] = b"".join((packed.getvalue()[:60], b"\xff" * 9, packed.getvalue()[69:]))
    (tmp_path / FILE).write_bytes(data.get(content, packed.getvalue()))
    with pytest.raises(ModelError, match="is damaged") as caught:
        RoomExamples.load(tmp_path)
    assert "\n" not in str(caught.value)


def test_features_of_another_network_by_that_name_are_refused():
    network = load_scene_classifier()
    shape = (2, len(network.labels))
    other = RoomExamples(
        network.name, np.eye(2, 3, dtype=np.float32), np.full(shape, 0.1, np.float32),
        ("kitchen", "hall"), ("a", "b"),
    )  # fmt: skip
    with pytest.raises(ModelError, match="3 features"):
        TaughtSceneClassifier(network, other).classify_image(np.zeros((64, 64, 3), np.uint8))


def test_the_examples_of_all_places_together_have_a_limit():
    def examples(place: str, n: int) -> RoomExamples:
        zeros = np.zeros((n, 2), np.float32)
        return RoomExamples("net", zeros, zeros, ("kitchen",) * n, (place,) * n)

    first = examples("a", MAX_EXAMPLES - 1)
    assert len(first.with_place(examples("b", 1)).label) == MAX_EXAMPLES
    with pytest.raises(ModelError, match="fewer images would work"):
        first.with_place(examples("b", 2))
