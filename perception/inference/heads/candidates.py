"""Candidates: boxes and masks as a network answers them, before overlapping ones are dropped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.frames import box_pixels
from perception.inference.class_labels import UNUSED_IDS
from perception.inference.session import Fitted

MAX_SIDE: Final = 8192  # cells of a grid's side


@dataclass(frozen=True, slots=True)
class MaskGrid:
    """A mask as its network answers it: positive where the thing is."""

    values: NDArray[np.float32]  # (h, w)
    extent: tuple[float, float, float, float]  # xyxy [px] of the image, edge to edge

    def within(self, box: NDArray[np.floating], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """The mask at the pixels of `box` (xyxy) in an image of `shape`, as `box_pixels` has them.

        Linear interpolation between the centres of the grid's cells.
        """
        pixels = box_pixels(box, shape)
        if pixels is None:
            return np.zeros((0, 0), bool)
        top, bottom, left, right = pixels
        height, width = self.values.shape
        if min(height, width) < 1 or max(height, width) > MAX_SIDE:
            raise ModelError(f"a mask of {width} x {height}; up to {MAX_SIDE} a side would work")
        x1, y1, x2, y2 = self.extent
        across, down = width / max(x2 - x1, 1e-6), height / max(y2 - y1, 1e-6)
        # centre of pixel (column, row) -> edges of the image -> centres of the grid's cells
        to_grid = np.array(
            [
                [across, 0, (left + 0.5 - x1) * across - 0.5],
                [0, down, (top + 0.5 - y1) * down - 0.5],
            ]
        )
        sampled = cv2.warpAffine(
            np.ascontiguousarray(self.values, np.float32),
            to_grid,
            (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        inside: NDArray[np.bool_] = sampled > 0
        return inside


def input_extent(fitted: Fitted) -> tuple[float, float, float, float]:
    """Part of the image that a network's whole input shows: xyxy [px], edge to edge."""
    height, width = fitted.tensor.shape[2:]
    low, high = ((at - np.array(fitted.shift)) / fitted.scale for at in (0.0, (width, height)))
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


SHARES: Final = 1.5  # up to which coordinates are shares of the input


def in_input(boxes: Floats, fitted: Fitted) -> Floats:
    """Boxes (n, 4) in pixels of the input: of these, or shares of it, as their values tell."""
    return boxes * input_corner(fitted) if are_shares(boxes) else boxes


def are_shares(boxes: Floats) -> bool:
    """Whether all coordinates (n, 4) that are numbers are shares of the input."""
    known = boxes[np.isfinite(boxes).all(axis=1)]
    return bool(len(known)) and float(np.abs(known).max()) <= SHARES


def input_corner(fitted: Fitted) -> Floats:
    """x, y, x, y [px] of the input's lower right corner."""
    return np.array(fitted.tensor.shape[:1:-1] * 2, np.float32)


MAX_CANDIDATES: Final = 30_000  # pairs of box and class, the best of them
MAX_OF_A_CLASS: Final = 1_000  # that suppression compares

Floats = NDArray[np.float32]
Inputs = dict[str, NDArray[np.generic]]
Outputs = list[NDArray[np.generic]]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Boxes of one image, each with one class; a box may come several times with others."""

    xyxy: Floats  # (n, 4) [px] of the image
    score: Floats  # (n,)
    label: NDArray[np.int64]  # (n,) index of the class
    mask: Callable[[int], MaskGrid] | None = None  # of the n-th


@dataclass(frozen=True, slots=True, kw_only=True)
class Head(ABC):
    """Meaning of a network's inputs and outputs."""

    image_input: str  # name of the input that takes the image
    outputs: tuple[str, ...]  # that `candidates` reads, in its order
    name: str  # of this reading, for `--head`
    classes: int | None = None  # None: unknown from the network
    first_label: int = 0  # number of the first class; 1 where 0 is the background
    gaps: bool = True  # whether unlabelled classes from 1 are COCO's ids, which leave out some
    resize: str = "stretch"  # as such networks want images (`perception.inference.session.fit`)
    values: str = "0..1"  # range and order of colours that they want
    overlapping: bool = False  # whether one thing may have several boxes, to be suppressed

    @property
    def unused(self) -> tuple[int, ...]:
        """Numbers that no class has, of a head whose first class is 1."""
        return UNUSED_IDS if self.gaps else (0,)

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> Inputs:
        """The network's inputs for an image of `shape` (height, width)."""
        return {self.image_input: fitted.tensor}

    def fits(self, outputs: Outputs, fitted: Fitted, threshold: float) -> bool:
        """Whether the values of an answer may have this meaning; yes where names tell the head."""
        return True

    @abstractmethod
    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
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
