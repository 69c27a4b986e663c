"""Candidates: boxes as a network answers them, before the overlapping ones are dropped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.inference.heads.masks import MaskGrid
from perception.inference.preprocessing import Fitted

MAX_CANDIDATES: Final = 30_000  # pairs of box and class, the best of them
MAX_OF_A_CLASS: Final = 1_000  # that suppression compares

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Boxes of one image, each with one class; a box may come several times with others."""

    xyxy: Floats  # (n, 4) [px] of the image
    score: Floats  # (n,)
    label: NDArray[np.int64]  # (n,) index of the class
    mask: Callable[[int], MaskGrid] | None = None  # of the n-th


class Head(Protocol):
    """Meaning of a network's inputs and outputs."""

    @property
    def image_input(self) -> str:
        """Name of the input that takes the image."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs that `candidates` reads, in its order."""

    @property
    def classes(self) -> int | None:
        """Number of classes; None: unknown from the network."""

    @property
    def resize(self) -> str:
        """How such networks want images resized (`perception.inference.preprocessing.fit`)."""

    @property
    def values(self) -> str:
        """Range and order of colours that they want."""

    @property
    def overlapping(self) -> bool:
        """Whether one thing may have several boxes, so that suppression is still to be done."""

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> dict[str, NDArray[np.generic]]:
        """The network's inputs for an image of `shape` (height, width)."""

    def candidates(
        self, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
    ) -> Candidates:
        """Boxes with scores above `threshold`; raises ModelError for outputs that do not fit."""


def pairs_above(
    scores: NDArray[np.floating], threshold: float
) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """(rows, classes) of scores (n, C) above `threshold`, at most the MAX_CANDIDATES best."""
    rows, classes = np.nonzero(scores > threshold)  # nan compares false
    if len(rows) > MAX_CANDIDATES:
        best = np.argpartition(-scores[rows, classes], MAX_CANDIDATES)[:MAX_CANDIDATES]
        best.sort()
        rows, classes = rows[best], classes[best]
    return rows, classes.astype(np.int64)


def suppress(
    xyxy: Floats, score: Floats, label: NDArray[np.int64], overlap: float, max_count: int
) -> NDArray[np.int64]:
    """Indices of the boxes (n, 4) that no better box of their class overlaps, best first.

    `overlap` is the IoU above which the weaker of two is dropped; each class keeps at most
    `max_count` boxes.
    """
    corners = xyxy.astype(np.float64)
    boxes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    kept = [np.zeros(0, np.int64)]
    for one in np.unique(label):
        of_class = np.nonzero(label == one)[0]
        best = cv2.dnn.NMSBoxes(
            boxes[of_class].tolist(), score[of_class].tolist(), 0.0, overlap, top_k=MAX_OF_A_CLASS
        )
        kept.append(of_class[np.asarray(best, np.int64).ravel()[:max_count]])
    chosen = np.concatenate(kept)
    return chosen[np.argsort(-score[chosen], kind="stable")]
