"""Scene classifiers that run an ONNX network.

One image input [N, 3, H, W] -> class scores [N, C], the output `probs` or else the first; scores
that are no probabilities yet go through a softmax. A second output `features` [N, F], where the
network has one, describes the image for learning new rooms from few examples. A network without a
card gets the centre crop in 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import Frame, SceneScores
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
