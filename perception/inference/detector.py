"""Object detectors that run an ONNX network.

The signature of a network tells the meaning of its outputs (`perception.inference.heads`). The
format of its input comes from the first of: its card (`perception.inference.model_zoo`), its own
metadata `resize` and `values`, and the usual format of networks with such a head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import Detections, Frame
from perception.inference.class_labels import COCO_IDS, is_object, labels_for
from perception.inference.heads.candidates import Head, MaskGrid, suppress
from perception.inference.heads.listed import QueryHead, RegionHead
from perception.inference.heads.signature import head_of
from perception.inference.model_zoo import ModelCard, resolve
from perception.inference.session import RESIZES, VALUES, Fitted, Session, fit

OVERLAP: Final = 0.6  # IoU above which the weaker of two boxes of one class is dropped
MAX_DETECTIONS: Final = 100  # of a class in an image, as COCO's evaluation counts
_HIGHEST: Final = 1.5  # sums of a network's shares are a little above 1 ...
_PERCENT: Final = 100.0  # ... and percent, or values before the sigmoid, are up to here


@dataclass(frozen=True, slots=True)
class OnnxDetector:
    """A detector that runs an ONNX network."""

    name: str
    session: Session
    labels: tuple[str, ...]
    head: Head
    resize: str
    values: str
    threshold: float  # least score, 0..1

    @property
    def device(self) -> str:
        """Device of the network: "cpu", "cuda", ..."""
        device: str = self.session.device
        return device

    def detect(self, frame: Frame) -> Detections:
        """All objects of `frame` with a score above the threshold, best first."""
        return self.detect_image(frame.rgb)

    def detect_image(self, rgb: NDArray[np.uint8]) -> Detections:
        """All objects of an image (H, W, 3) with a score above the threshold, best first.

        A box comes once for each class that the network gives it; of a class at most 100.
        """
        shape = (rgb.shape[0], rgb.shape[1])
        size = self.session.image_size(self.head.image_input)
        fitted = fit(rgb, size, self.resize, self.values)
        answer = self.session.run(self.head.outputs, self.head.inputs(fitted, shape))
        try:
            return self._decoded(answer, fitted, shape)
        except ModelError as error:
            raise ModelError(f"{self.name}: {error}") from error
        except (IndexError, ValueError) as error:  # shapes that it does not declare
            shapes = ", ".join(str(output.shape) for output in answer)
            raise ModelError(
                f"{self.name} gives outputs that do not belong together: {shapes} ({error})"
            ) from error

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
        xyxy = np.clip(found.xyxy, 0, np.array([shape[1], shape[0]] * 2, np.float32))
        sides = xyxy[:, 2:] - xyxy[:, :2]
        real = np.nonzero(np.isfinite(xyxy).all(1) & (sides > 0).all(1))[0]
        real = real[[is_object(self._label(int(i))) for i in found.label[real]]]
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
    threads: int | None = None,
    device: str = "cpu",
) -> OnnxDetector:
    """Open a detector: "default", a known name (see perception.inference.model_zoo), or an ONNX
    file.

    `labels` (a list, or a file with one a line) override what the network or its card says.
    `device` is "auto", "cpu", "cuda", ... Raises ModelError for anything that is no detector of a
    known interface, and for a device that is not there.
    """
    if not 0 <= threshold < 1:
        raise ModelError(f"a score threshold lies in 0..1, got {threshold}")
    path, card = resolve(name_or_path, "detector")
    session = Session(path, threads, device)
    head = head_of(session)
    session.image_size(head.image_input)
    head, known = _labelled(head, session, labels, card)
    resize, values = _preparation(head, session, card)
    return OnnxDetector(
        name=card.name if card is not None else path.stem,
        session=session,
        labels=known,
        head=head,
        resize=resize,
        values=values,
        threshold=threshold,
    )


def _labelled(
    head: Head, session: Session, given: Sequence[str] | Path | None, card: ModelCard | None
) -> tuple[Head, tuple[str, ...]]:
    """The labels of the classes, and the head, whose last class they may show to be none."""

    def labels(classes: int | None) -> tuple[str, ...]:
        path, metadata = session.path, session.metadata
        return labels_for(path, classes, given=given, metadata=metadata, card=card)

    if isinstance(head, RegionHead) and given is None and card is None:
        try:
            return head, labels(COCO_IDS)
        except ModelError:
            return head, labels(None)
    try:
        return head, labels(head.classes)
    except ModelError:
        if not isinstance(head, QueryHead) or head.classes is None:
            raise
        known = labels(head.classes - 1)
        values = "imagenet"  # as DETR itself was trained
        return replace(head, no_object=True, values=values), known


def _preparation(head: Head, session: Session, card: ModelCard | None) -> tuple[str, str]:
    """How images are resized, and their values."""
    if card is not None:
        return card.resize, card.values
    resize = session.metadata.get("resize", head.resize)
    values = session.metadata.get("values", head.values)
    for name, value, known in (("resize", resize, RESIZES), ("values", values, VALUES)):
        if value not in known:
            raise ModelError(
                f"{session.path.name}: metadata {name} is {value!r}; known: {', '.join(known)}"
            )
    return resize, values
