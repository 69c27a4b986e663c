"""The bundled encoder of looks: features of a picture, and log-probabilities of its classes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.camera.image_decoding import decode_picture
from perception.inference.model_zoo import resolve
from perception.inference.session import Session, fit

FEATURES: Final = 1280
CLASSES: Final = 1000  # of ImageNet
_OUTPUTS: Final = ("features", "imagenet_logits")


@dataclass(frozen=True, slots=True)
class LookNetwork:
    """A network that describes pictures of things."""

    name: str
    session: Session

    @property
    def checksum(self) -> str:
        """Its name, which no other bundled network has."""
        return self.name

    @property
    def size(self) -> int:
        """Number of values of a picture."""
        return FEATURES + CLASSES

    def describe(self, picture: bytes) -> NDArray[np.float32]:
        """Features, and behind them log-probabilities of ImageNet's classes, of a JPEG or PNG.

        Raises RecordingError for a damaged picture, and ModelError for one that shows nothing.
        """
        name = next(iter(self.session.inputs))
        rgb = decode_picture(picture)
        fitted = fit(rgb, self.session.image_size(name), "letterbox", "0..255")
        features, logits = self.session.run(_OUTPUTS, {name: fitted.tensor})
        scores = logits[0].astype(np.float64) - logits[0].max()
        log_p = scores - np.log(np.exp(scores).sum())
        return np.concatenate([features[0], log_p]).astype(np.float32)


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
