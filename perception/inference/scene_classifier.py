"""Scene classifiers that run an ONNX network.

One image input [N, 3, H, W] -> class scores [N, C], the output `probs` or else the first; scores
that are no probabilities yet go through a softmax. A second output `features` [N, F], where the
network has one, describes the image for learning new rooms from few examples. A network without a
card gets the centre crop in 0..255.

Rooms are taught on the spot by a linear head over the frozen features of a scene classifier. With
features f of an image, centred at the mean of the examples and of length one, and the network's own
probability p_c, the taught category c scores log p_c + w_c f; categories that were not taught score
log p_c. The weights are those of a multinomial logistic regression over the examples with an L2
penalty. They sum to zero over the categories, so that a single taught kind of room changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import Frame, SceneScores
from perception.inference.array_file import DAMAGE, read_arrays, write_arrays
from perception.inference.class_labels import labels_for
from perception.inference.model_zoo import resolve
from perception.inference.session import Session, fit


@dataclass(frozen=True, slots=True)
class OnnxSceneClassifier:
    """A scene classifier that runs an ONNX network."""

    name: str
    session: Session
    labels: tuple[str, ...]
    output: str
    resize: str
    values: str

    @property
    def device(self) -> str:
        """Device of the network: "cpu", "cuda", ..."""
        return self.session.device

    def classify(self, frame: Frame) -> SceneScores:
        """Probability of each scene category for `frame`."""
        return self.classify_image(frame.rgb)

    def classify_image(self, rgb: NDArray[np.uint8]) -> SceneScores:
        """Probability of each scene category for an image (H, W, 3)."""
        probability = _probabilities(self._run(rgb, self.output)[0])
        pairs = zip(self.labels, probability.tolist(), strict=True)
        return SceneScores(dict(pairs))

    def described(self, rgb: NDArray[np.uint8]) -> tuple[SceneScores, NDArray[np.float32]]:
        """Scene scores and (F,) features of an image (H, W, 3), in one run of the network.

        Raises ModelError where the network gives no features.
        """
        if "features" not in self.session.outputs:
            raise ModelError(f"{self.name} has no output 'features': {self.session.interface()}")
        scores, features = self._run(rgb, self.output, "features")
        pairs = zip(self.labels, _probabilities(scores).tolist(), strict=True)
        return SceneScores(dict(pairs)), features

    def _run(self, rgb: NDArray[np.uint8], *outputs: str) -> list[NDArray[np.float32]]:
        name = next(iter(self.session.inputs))
        fitted = fit(rgb, self.session.image_size(name), self.resize, self.values)
        answers = self.session.run(outputs, {name: fitted.tensor})
        if any(answer.ndim != 2 or not len(answer) for answer in answers):
            shapes = ", ".join(str(answer.shape) for answer in answers)
            raise ModelError(f"{self.name} gives outputs of shapes {shapes}; [1, C] would work")
        return [answer.astype(np.float32)[0] for answer in answers]


def _probabilities(scores: NDArray[np.float32]) -> NDArray[np.float64]:
    """Scores (C,) as probabilities: as they are if they sum to one, else their softmax."""
    exact = scores.astype(np.float64)
    if exact.ndim != 1 or not len(exact) or not np.isfinite(exact).all():
        raise ModelError("the scene classifier gives no finite score for each class")
    weight = exact
    if exact.min() < 0 or abs(exact.sum() - 1) > 1e-2:
        weight = np.exp(exact - exact.max())
    probability: NDArray[np.float64] = weight / weight.sum()
    return probability


def load_scene_classifier(
    name_or_path: str | Path = "default",
    *,
    labels: Sequence[str] | Path | None = None,
    device: str = "cpu",
) -> OnnxSceneClassifier:
    """Open a scene classifier: "default", a known name (see perception.inference.model_zoo), or an
    ONNX file.

    `labels` (a list, or a file with one a line) override what the network or its card says.
    `device`: see `perception.inference.detector.load_detector`. Raises ModelError for anything that
    is no image classifier.
    """
    path, card = resolve(name_or_path, "scene")
    session = Session(path, None, device)
    output, classes = _interface(session)
    return OnnxSceneClassifier(
        name=card.name if card is not None else path.stem,
        session=session,
        labels=labels_for(path, classes, given=labels, metadata=session.metadata, card=card),
        output=output,
        resize=card.resize if card is not None else "crop",
        values=card.values if card is not None else "0..255",
    )


def _interface(session: Session) -> tuple[str, int]:
    """(output with class scores, number of classes); raises ModelError for another interface."""
    output = "probs" if "probs" in session.outputs else next(iter(session.outputs))
    shape = session.outputs[output]
    if len(session.inputs) != 1 or len(shape) != 2 or not isinstance(shape[1], int):
        raise ModelError(
            f"{session.path.name} is no scene classifier ({session.interface()}); "
            "known: image [N, 3, H, W] -> class scores [N, C]"
        )
    session.image_size(next(iter(session.inputs)))
    return output, shape[1]


FILE: Final = "taught_rooms.npz"  # in the folder of a map
MAX_EXAMPLES: Final = 5000
_MAX_BYTES: Final = 1 << 28  # bytes of the file
_PENALTY: Final = 0.003
_STEPS: Final = 300
_CONSTANT: Final = 0.3  # value of the feature that stands for the intercept
_FLOOR: Final = 1e-3  # least probability of the network that counts

Floats = NDArray[np.float64]


def room_examples(
    network: OnnxSceneClassifier,
    images: Iterable[NDArray[np.uint8]],
    *,
    label: str,
    place: str,
) -> RoomExamples:
    """Examples of one place from images (H, W, 3) that show a room of kind `label`.

    Raises ModelError where there are none, or the network gives no features.
    """
    found = [network.described(rgb) for rgb in images]
    if not found:
        raise ModelError("no images to learn from")
    return RoomExamples(
        network.name,
        np.stack([features for _, features in found]),
        np.array([list(scores.probability.values()) for scores, _ in found], np.float32),
        (label,) * len(found),
        (place,) * len(found),
    )


@dataclass(frozen=True, slots=True)
class RoomExamples:
    """Features of images, each with the kind of its room and with its place."""

    network: str  # whose features they are
    features: NDArray[np.float32]  # (n, F)
    probability: NDArray[np.float32]  # (n, C) of the network's own categories
    label: tuple[str, ...]  # (n,)
    place: tuple[str, ...]  # (n,) IRI

    def __post_init__(self) -> None:
        n = len(self.label)
        shapes = self.features.shape, self.probability.shape
        sound = all(len(s) == 2 and s[0] == n for s in shapes) and len(self.place) == n > 0
        if not sound or n > MAX_EXAMPLES:
            raise ValueError(f"{n} labels, {len(self.place)} places, arrays of shapes {shapes}")
        if not (np.isfinite(self.features).all() and np.isfinite(self.probability).all()):
            raise ValueError("numbers that are not finite")

    def with_place(self, other: RoomExamples) -> RoomExamples:
        """These examples, with `other` in place of the examples of its places.

        Raises ModelError where they are of different networks, or too many together.
        """
        kept = [i for i, one in enumerate(self.place) if one not in other.place]
        if self.network != other.network:
            raise ModelError(
                f"rooms of this map were taught to {self.network}: "
                f"--scene {self.network} would work"
            )
        if len(kept) + len(other.label) > MAX_EXAMPLES:
            raise ModelError(f"more than {MAX_EXAMPLES} examples in all; fewer images would work")
        return RoomExamples(
            self.network,
            np.concatenate([self.features[kept], other.features]),
            np.concatenate([self.probability[kept], other.probability]),
            (*(self.label[i] for i in kept), *other.label),
            (*(self.place[i] for i in kept), *other.place),
        )

    def save(self, folder: Path) -> None:
        """Write them into the folder of a map, over former ones; raises ModelError."""
        arrays = {
            "network": np.array(self.network),
            "features": self.features.astype(np.float16),
            "probability": self.probability,
            "label": np.array(self.label, dtype=np.str_),
            "place": np.array(self.place, dtype=np.str_),
        }
        write_arrays(folder / FILE, arrays)

    @classmethod
    def load(cls, folder: Path) -> Self | None:
        """Examples in the folder of a map; None where nothing was taught.

        Raises ModelError for a file that is damaged.
        """
        path = folder / FILE
        if not path.is_file():
            return None
        try:
            data = read_arrays(path, _MAX_BYTES)
            return cls(
                str(data["network"]),
                data["features"].astype(np.float32),
                data["probability"].astype(np.float32),
                tuple(map(str, data["label"].tolist())),
                tuple(map(str, data["place"].tolist())),
            )
        except DAMAGE as error:
            raise ModelError(
                f"{path} is damaged ({error}); without it rooms can be taught again"
            ) from error


class TaughtSceneClassifier:
    """A scene classifier that knows the rooms it was taught beside its own."""

    def __init__(self, network: OnnxSceneClassifier, examples: RoomExamples) -> None:
        if examples.network != network.name:
            raise ModelError(
                f"rooms were taught to {examples.network}, not to {network.name}; "
                f"--scene {examples.network} would work, or teaching them again"
            )
        self._network = network
        self.labels = tuple(dict.fromkeys(examples.label))  # taught
        own = network.labels
        if examples.probability.shape[1] != len(own):
            raise ModelError(f"{network.name} has other labels than when rooms were taught to it")
        self._columns = [own.index(label) if label in own else -1 for label in self.labels]
        self._mean = examples.features.mean(axis=0)
        known = np.stack([self._own(p) for p in examples.probability])
        truth = np.array([self.labels.index(label) for label in examples.label])
        self._weights = _fitted(self._centred(examples.features), truth, np.log(known))

    @property
    def name(self) -> str:
        """Name of the network behind it."""
        return self._network.name

    @property
    def device(self) -> str:
        """Device of the network."""
        return self._network.device

    def classify(self, frame: Frame) -> SceneScores:
        """Probability of each scene category for `frame`."""
        return self.classify_image(frame.rgb)

    def classify_image(self, rgb: NDArray[np.uint8]) -> SceneScores:
        """Probability of each scene category for an image (H, W, 3)."""
        found, features = self._network.described(rgb)
        if features.shape != self._mean.shape:
            raise ModelError(
                f"rooms were taught to another {self.name}: {len(self._mean)} features, not "
                f"{len(features)}; teaching them again would work"
            )
        scores = dict(found.probability)
        own = np.array(list(scores.values()))
        log = np.log(self._own(own)) + (self._centred(features[None]) @ self._weights)[0]
        taught = dict(zip(self.labels, np.exp(np.minimum(log, 50.0)).tolist(), strict=True))
        scores = {label: max(p, _FLOOR) for label, p in scores.items()} | taught
        total = sum(scores.values())
        return SceneScores({label: p / total for label, p in scores.items()})

    def _own(self, probability: NDArray[np.floating]) -> Floats:
        """(C,) the network's probability of each taught category; of one it lacks, that of any."""
        unknown = 1 / len(self._network.labels)
        chosen = [probability[c] if c >= 0 else unknown for c in self._columns]
        return np.maximum(np.array(chosen, np.float64), _FLOOR)

    def _centred(self, features: NDArray[np.float32]) -> Floats:
        """(n, F + 1) features (n, F) from their mean, of length one, and a constant."""
        offset = (features - self._mean).astype(np.float64)
        length = np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-9)
        constant = np.full((len(offset), 1), _CONSTANT)
        return np.concatenate([offset / length, constant], axis=1)


def _fitted(features: Floats, truth: NDArray[np.intp], offset: Floats) -> Floats:
    """Weights (F, C) of the regression of `truth` (n,) on features (n, F), by Nesterov's descent.

    `offset` (n, C) are scores that the weights add to.
    """
    wanted = np.eye(offset.shape[1])[truth]
    weights = ahead = np.zeros((features.shape[1], offset.shape[1]))
    slope = 0.5 * np.linalg.norm(features, 2) ** 2 / len(features) + _PENALTY
    for step in range(_STEPS):
        scores = features @ ahead + offset
        chance = np.exp(scores - scores.max(axis=1, keepdims=True))
        chance /= chance.sum(axis=1, keepdims=True)
        gradient = features.T @ (chance - wanted) / len(features) + _PENALTY * ahead
        following = ahead - gradient / slope
        ahead = following + step / (step + 3) * (following - weights)
        weights = following
    return weights
