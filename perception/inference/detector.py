"""Object detectors that run an ONNX network.

The signature of a network tells the meaning of its outputs (`perception.inference.heads`). The
format of its input comes from the first of: its card (`perception.inference.model_zoo`), its own
metadata `resize` and `values`, and the usual format of networks with such a head.

Where outputs may mean several things, the first answers decide
(`perception.inference.interpretations`).
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import NO_DETECTIONS, Detections, Frame
from perception.inference.class_labels import COCO_IDS, NO_OBJECT, is_object, labels_for
from perception.inference.heads.candidates import Head, MaskGrid, suppress
from perception.inference.heads.listed import QueryHead
from perception.inference.heads.signature import heads_of
from perception.inference.interpretations import Answer, Interpretation, Interpretations
from perception.inference.model_zoo import ModelCard, resolve
from perception.inference.second_opinion import SecondOpinion
from perception.inference.session import RESIZES, VALUES, Fitted, Session, fit

_log = logging.getLogger(__name__)
BAD: Final = 1 / 3  # share of boxes that make no sense, from which none does, ...
CLEAR: Final = 0.5  # ... of those with such a score
OVERLAP: Final = 0.6  # IoU above which the weaker of two boxes of one class is dropped
MAX_DETECTIONS: Final = 100  # of a class in an image, as COCO's evaluation counts
_HIGHEST: Final = 1.5  # sums of a network's shares are a little above 1 ...
_FAR: Final = 1e6  # [px] from which a coordinate is no number at all
_PERCENT: Final = 100.0  # ... and percent, or values before the sigmoid, are up to here


@dataclass(frozen=True, slots=True)
class OnnxDetector:
    """A detector that runs an ONNX network."""

    name: str
    session: Session
    readings: Interpretations  # what its outputs may mean
    threshold: float  # least score, 0..1
    second: SecondOpinion | None = None  # on its first answers, where no card has its labels

    @property
    def head(self) -> Head:
        """The meaning of its outputs; the likeliest, until a first answer decides."""
        return self.readings.likeliest.head

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of its classes."""
        return self.readings.likeliest.labels

    @property
    def resize(self) -> str:
        """The way in which images are resized for it."""
        return self.readings.likeliest.resize

    @property
    def values(self) -> str:
        """Range and order of the colours that it takes."""
        return self.readings.likeliest.values

    @property
    def device(self) -> str:
        """Device of the network: "cpu", "cuda", ..."""
        return self.session.device

    def detect(self, frame: Frame) -> Detections:
        """All objects of `frame` with a score above the threshold, best first."""
        return self.detect_image(frame.rgb)

    def detect_image(self, rgb: NDArray[np.uint8]) -> Detections:
        """All objects of an image (H, W, 3) with a score above the threshold, best first.

        A box comes once for each class that the network gives it; of a class at most 100.
        """
        answer: list[NDArray[np.generic]] = []
        shape = (rgb.shape[0], rgb.shape[1])

        @cache
        def answer_of(reading: Interpretation) -> Answer:
            head = reading.head
            size = self.session.image_size(head.image_input)
            fitted = fit(rgb, size, reading.resize, reading.values)
            answer[:] = found = self.session.run(head.outputs, head.inputs(fitted, shape))
            return found, fitted

        try:
            if values := self.readings.choose_range(answer_of, self.threshold):
                _log.warning(
                    "%s shows nothing in a picture with colours in its usual range, and something "
                    "as %r, which is taken; metadata values in the file would say it",
                    self.name,
                    values,
                )
            if not self.readings.decide(answer_of, self.threshold):
                return NO_DETECTIONS
            found = self._decoded(*answer_of(self.readings.likeliest), shape)
        except ModelError as error:
            if str(error).startswith(self.session.path.name):
                raise
            raise ModelError(f"{self.name}: {error}") from error
        except (IndexError, ValueError) as error:  # shapes that it does not declare
            shapes = ", ".join(str(output.shape) for output in answer)
            raise ModelError(
                f"{self.name} gives outputs that do not belong together: {shapes} ({error})"
            ) from error
        if self.second is not None:
            self.second.compare(rgb, found)
        return found

    def _decoded(
        self, answer: list[NDArray[np.generic]], fitted: Fitted, shape: tuple[int, int]
    ) -> Detections:
        found = self.head.candidates(answer, fitted, self.threshold)
        highest = float(np.max(found.score, initial=0.0))
        if _HIGHEST < highest <= _PERCENT:
            raise ModelError(
                f"scores up to {highest:g} are no shares of 1 (percent, or values before the "
                "sigmoid?): export the network so that its scores lie in 0..1"
            )
        self._check_boxes(found.xyxy[found.score >= CLEAR], shape)
        xyxy = np.clip(found.xyxy, 0, np.array([shape[1], shape[0]] * 2, np.float32))
        sides = xyxy[:, 2:] - xyxy[:, :2]
        real = np.nonzero(np.isfinite(xyxy).all(1) & (sides > 0).all(1))[0]
        real = real[[is_object(self._label(int(i))) for i in found.label[real]]]
        unused = found.label[np.isin(found.label, self.head.unused) & (found.score >= CLEAR)]
        if self.head.first_label == 1 and len(unused):
            raise ModelError(
                f"the network answered class {unused[0]}, which {self.head.name} has for nothing: "
                "--head takes another reading, or give the labels it was trained with"
            )
        overlap = OVERLAP if self.head.overlapping else 1.0
        chosen = (found.xyxy[real], found.score[real], found.label[real])
        kept = real[suppress(*chosen, overlap, MAX_DETECTIONS)]
        masks: list[NDArray[np.bool_] | None] = []
        if found.mask is not None:
            masks = [_mask(found.mask(int(i)), xyxy[i], shape) for i in kept]
        return Detections(
            xyxy[kept].astype(np.float32),
            # sums of a network's shares may exceed 1
            np.clip(found.score[kept], 0, 1).astype(np.float32),
            tuple(self._label(int(i)) for i in found.label[kept]),
            mask=tuple(masks),
        )

    def _check_boxes(self, xyxy: NDArray[np.float32], shape: tuple[int, int]) -> None:
        """Raise ModelError where boxes end before they begin, or lie outside the image."""
        boxes = xyxy[(np.abs(xyxy) < _FAR).all(axis=1)]
        reverse = (boxes[:, 2:] < boxes[:, :2]).any(axis=1).sum()
        if reverse > BAD * len(boxes):
            raise ModelError(
                f"{reverse} of its {len(boxes)} boxes end before they begin, as of centre and "
                "size; export the network so that they are x1, y1, x2, y2"
            )
        centre = (boxes[:, :2] + boxes[:, 2:]) / 2
        outside = (centre < 0).any(axis=1) | (centre > shape[::-1]).any(axis=1)
        if outside.sum() > BAD * len(boxes):
            raise ModelError(
                f"{outside.sum()} of its {len(boxes)} boxes lie outside the image, as in another "
                f"unit, of another size or with y first; read as {self.head.name}, --head takes "
                "another"
            )

    def _label(self, index: int) -> str:
        if 0 <= index < len(self.labels):
            return self.labels[index]
        raise ModelError(
            f"the network answered class {index}, its {len(self.labels)} labels "
            "end before: give the labels it was trained with"
        )


def _mask(
    grid: MaskGrid, box: NDArray[np.float32], shape: tuple[int, int]
) -> NDArray[np.bool_] | None:
    """The pixels of a box that show its thing; None where the network found none."""
    inside = grid.within(box, shape)
    return inside if inside.any() else None


def load_detector(
    name_or_path: str | Path = "default",
    *,
    threshold: float = 0.25,
    labels: Sequence[str] | Path | None = None,
    head: str | None = None,
    threads: int | None = None,
    device: str = "cpu",
) -> OnnxDetector:
    """Open a detector: "default", a known name (see perception.inference.model_zoo), or an ONNX
    file.

    `labels` (a list, or a file with one a line) override what the network or its card says. `head`
    is the meaning of its outputs, where a first answer leaves two: the error names them.
    `device` is "auto", "cpu", "cuda", ... Raises ModelError for anything that is no detector of a
    known interface, and for a device that is not there.
    """
    if not 0 <= threshold < 1:
        raise ModelError(f"a score threshold lies in 0..1, got {threshold}")
    path, card = resolve(name_or_path, "detector")
    session = Session(path, threads, device)
    heads = heads_of(session)
    for one in heads:
        session.image_size(one.image_input)
    if head is not None and head not in (names := [one.name for one in heads]):
        raise ModelError(f"{path.name} has no head {head!r}; it may have {', '.join(names)}")
    readings, problems = list[Interpretation](), list[ModelError]()
    for one in heads:
        if head in (None, one.name):
            try:
                known, of_labels = _labelled(one, session, labels, card)
                if any(replace(other.head, name=one.name) == known for other in readings):
                    continue  # by labels that somebody gives, two numberings are one
                readings.append(
                    Interpretation(known, of_labels, *_preparation(known, session, card))
                )
            except ModelError as error:
                problems.append(error)
    if not readings:
        raise problems[0]
    others = "".join(f"; or {problem}" for problem in dict.fromkeys(map(str, problems)))
    name = card.name if card is not None else path.stem
    bytes_ = session.takes_bytes(readings[0].head.image_input)
    guessed = card is None and "values" not in session.metadata and not bytes_
    chosen = len(readings) == 1 and (card is not None or head is not None)
    known_by = Interpretations(readings, others, guessed=guessed, chosen=chosen)
    second = None
    if card is None or labels is not None:
        second = SecondOpinion(name, readings[0].labels, lambda: load_detector().detect_image)
    return OnnxDetector(name, session, known_by, threshold, second)


def _labelled(
    head: Head, session: Session, given: Sequence[str] | Path | None, card: ModelCard | None
) -> tuple[Head, tuple[str, ...]]:
    """The labels of the classes, and the head, whose last class they may show to be none."""

    def labels(classes: int | None) -> tuple[str, ...]:
        path, metadata = session.path, session.metadata
        return labels_for(path, classes, given=given, metadata=metadata, card=card)

    if head.first_label == 1:
        with contextlib.suppress(ModelError):
            if head.gaps:
                return head, labels(COCO_IDS)
        known = labels(None)
        known = (NO_OBJECT, *known) if is_object(known[0]) else known
        return replace(head, gaps=False), known
    try:
        return head, labels(head.classes)
    except ModelError:
        if not isinstance(head, QueryHead) or head.classes is None:
            raise
        known = labels(head.classes - 1)
        values = "imagenet"  # as DETR itself was trained
        return replace(head, no_object=True, values=values), known


def _preparation(head: Head, session: Session, card: ModelCard | None) -> tuple[str, str]:
    """The way in which images are resized, and their values."""
    if card is not None:
        return card.resize, card.values
    resize = session.metadata.get("resize", head.resize)
    usual = "0..255" if session.takes_bytes(head.image_input) else head.values
    values = session.metadata.get("values", usual)
    for name, value, known in (("resize", resize, RESIZES), ("values", values, VALUES)):
        if value not in known:
            raise ModelError(
                f"{session.path.name}: metadata {name} is {value!r}; known: {', '.join(known)}"
            )
    return resize, values
