"""Looks of things: features of a picture, and how likely it shows each of ImageNet's classes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.camera.image_decoding import decode_image
from perception.inference.model_zoo import resolve
from perception.inference.session import Session, fit

FEATURES: Final = 1280
CLASSES: Final = 1000  # of ImageNet
_OUTPUTS: Final = ("features", "imagenet_logits")
_PLAIN: Final = 4.0  # standard deviation of the grey values below which a picture shows nothing


@dataclass(frozen=True, slots=True)
class LookNetwork:
    """A network that describes pictures of things."""

    name: str
    session: Session

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of features and of classes."""
        return FEATURES, CLASSES

    def describe(self, picture: bytes) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Features (F,) and log-probabilities (C,) of ImageNet's classes of a JPEG or PNG.

        Raises RecordingError for a damaged picture, and ModelError for one that shows nothing.
        """
        data = np.frombuffer(picture, np.uint8)
        bgr = np.asarray(decode_image(data, cv2.IMREAD_COLOR, "the picture"), np.uint8)
        if bgr.mean(axis=2).std() < _PLAIN:
            raise ModelError("the picture shows nothing: it has one colour")
        name = next(iter(self.session.inputs))
        rgb = np.ascontiguousarray(bgr[:, :, ::-1])
        fitted = fit(rgb, self.session.image_size(name), "letterbox", "0..255")
        features, logits = self.session.run(_OUTPUTS, {name: fitted.tensor})
        scores = logits[0].astype(np.float64) - logits[0].max()
        log_p = scores - np.log(np.exp(scores).sum())
        return features[0].astype(np.float32), log_p.astype(np.float32)


def load_look_network() -> LookNetwork:
    """The default scene classifier, which has features and ImageNet's classes too.

    Raises ModelError for a network without them.
    """
    path, card = resolve("default", "scene")
    session = Session(path, None, "cpu")
    sizes = [tuple(session.outputs.get(output, ())[1:]) for output in _OUTPUTS]
    if sizes != [(FEATURES,), (CLASSES,)]:
        raise ModelError(
            f"{path.name} does not describe things ({session.interface()}); the bundled scene "
            "classifier would work"
        )
    return LookNetwork(card.name if card is not None else path.stem, session)
