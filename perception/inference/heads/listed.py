"""Heads that answer a short list of things, one box each, and need no suppression.

set prediction   exports of RT-DETR, D-FINE and DEIM with `orig_target_sizes`: labels, boxes (xyxy
                 in image pixels), scores
queries          DETR and its kin as trained: logits (Q, C), boxes (Q, 4) centre and size as shares
                 of the image; Carion et al. 2020 (arXiv 2005.12872), softmax over C - 1 classes and
                 "no object", later ones a sigmoid for each class; masks (Q, h, w) of logits
end to end       YOLOv10 and later, and exports with suppression inside: rows x1, y1, x2, y2 [px of
                 the input], score, class, and of segmenting ones coefficients of prototype masks
regions          torchvision's: boxes [px of the input], labels from 1, scores, and of Mask R-CNN
                 (He et al. 2017, arXiv 1703.06870) probabilities, of the image or of each box
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.inference.heads.candidates import Candidates, MaskGrid, input_extent, pairs_above
from perception.inference.heads.dense import check_equal_length, prototype_masks
from perception.inference.session import Fitted

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class SetPredictionHead:
    """labels, boxes [px of the image], scores; a second input takes the image's size."""

    image_input: str
    size_input: str
    outputs: tuple[str, ...] = ("labels", "boxes", "scores")
    classes: int | None = None
    resize: str = "stretch"
    values: str = "0..1"
    overlapping: bool = False

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> dict[str, NDArray[np.generic]]:
        """The image, and its width and height."""
        size = np.array([[shape[1], shape[0]]], np.int64)
        return {self.image_input: fitted.tensor, self.size_input: size}

    def candidates(
        self, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
    ) -> Candidates:
        """The candidates above the threshold."""
        labels, boxes, scores = (output[0] for output in outputs)
        check_equal_length(boxes, scores, labels)
        return _listed(boxes, scores, labels, threshold)


@dataclass(frozen=True, slots=True)
class QueryHead:
    """logits (Q, C), boxes (Q, 4) as shares of the image, and perhaps masks (Q, h, w)."""

    image_input: str
    outputs: tuple[str, ...]
    classes: int | None
    values: str
    no_object: bool = False  # whether the last class is "no object"
    mask_input: tuple[str, tuple[int, ...]] | None = None  # of the mask of valid pixels
    resize: str = "stretch"
    overlapping: bool = False

    def inputs(self, fitted: Fitted, _: tuple[int, int]) -> dict[str, NDArray[np.generic]]:
        """The image, and where the network asks for it a mask that takes all of it."""
        found: dict[str, NDArray[np.generic]] = {self.image_input: fitted.tensor}
        if self.mask_input is not None:
            name, shape = self.mask_input
            found[name] = np.ones(shape, np.int64)
        return found

    def candidates(
        self, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
    ) -> Candidates:
        """Every pair of query and class above the threshold."""
        logits, shares = (output.astype(np.float32)[0] for output in outputs[:2])
        check_equal_length(shares, logits)
        with np.errstate(over="ignore"):
            if self.no_object:
                weight = np.exp(logits - logits.max(1, keepdims=True, initial=-np.inf))
                scores = (weight / weight.sum(1, keepdims=True))[:, :-1]
            else:
                scores = 1 / (1 + np.exp(-logits))
        rows, classes = pairs_above(scores, threshold)
        x1, y1, x2, y2 = input_extent(fitted)
        chosen = shares[rows]
        half = chosen[:, 2:] / 2
        corners = np.concatenate([chosen[:, :2] - half, chosen[:, :2] + half], axis=1)
        boxes = corners * np.array([x2 - x1, y2 - y1] * 2) + np.array([x1, y1] * 2)
        mask = None
        if len(outputs) > 2:
            grids = outputs[2].astype(np.float32)[0]
            if len(grids) != len(logits):
                raise ModelError(f"the network gives {len(grids)} masks for {len(logits)} queries")
            mask = _whole_masks(grids[rows], fitted)
        return Candidates(boxes.astype(np.float32), scores[rows, classes], classes, mask)


@dataclass(frozen=True, slots=True)
class EndToEndHead:
    """Rows (K, 6 + M) of finished detections, and with M > 0 prototypes (M, h, w)."""

    image_input: str
    outputs: tuple[str, ...]
    classes: int | None = None
    resize: str = "letterbox"
    values: str = "0..1"
    overlapping: bool = False

    def inputs(self, fitted: Fitted, _: tuple[int, int]) -> dict[str, NDArray[np.generic]]:
        """The image alone."""
        return {self.image_input: fitted.tensor}

    def candidates(
        self, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
    ) -> Candidates:
        """The candidates above the threshold."""
        rows = outputs[0].astype(np.float32)[0]
        rows = rows[rows[:, 4] > threshold]
        mask = None
        if len(outputs) > 1:
            mask = prototype_masks(rows[:, 6:], outputs[1].astype(np.float32)[0], fitted)
        boxes = fitted.to_image(rows[:, :4])
        return Candidates(boxes, rows[:, 4], _whole_numbers(rows[:, 5]), mask)


@dataclass(frozen=True, slots=True)
class RegionHead:
    """boxes (n, 4) [px of the input], labels (n,), scores (n,), and perhaps masks of each."""

    image_input: str
    outputs: tuple[str, ...]
    batched: bool  # whether the boxes have a batch dimension
    image_batched: bool  # whether the image has one
    classes: int | None = None
    resize: str = "stretch"
    values: str = "0..1"
    overlapping: bool = False

    def inputs(self, fitted: Fitted, _: tuple[int, int]) -> dict[str, NDArray[np.generic]]:
        """The image alone."""
        return {self.image_input: fitted.tensor if self.image_batched else fitted.tensor[0]}

    def candidates(
        self, outputs: list[NDArray[np.generic]], fitted: Fitted, threshold: float
    ) -> Candidates:
        """The candidates above the threshold."""
        boxes, labels, scores, *masks = (o[0] if self.batched else o for o in outputs)
        check_equal_length(boxes, scores, labels, *masks)
        found = _listed(boxes, scores, labels, threshold)
        chosen = np.nonzero(scores.astype(np.float32) > threshold)[0]
        image = fitted.to_image(found.xyxy)
        mask = None
        if masks:
            grids = masks[0].astype(np.float32)[chosen]
            grids = (grids[:, 0] if grids.ndim == 4 else grids) - np.float32(0.5)
            whole = grids.shape[1:] == fitted.tensor.shape[2:]
            mask = _whole_masks(grids, fitted) if whole else _box_masks(grids, image)
        return Candidates(image, found.score, found.label, mask)


def _listed(
    boxes: NDArray[np.generic],
    scores: NDArray[np.generic],
    labels: NDArray[np.generic],
    threshold: float,
) -> Candidates:
    score = scores.astype(np.float32)
    good = score > threshold
    xyxy = boxes.astype(np.float32)[good]
    return Candidates(xyxy, score[good], _whole_numbers(labels[good].astype(np.float32)))


def _whole_numbers(labels: Floats) -> NDArray[np.int64]:
    """Class indices from numbers; -1, the index of no class, for a number that is not finite."""
    good = np.isfinite(labels) & (np.abs(labels) < 1e6)
    return np.where(good, np.rint(np.where(good, labels, 0)), -1).astype(np.int64)


def _whole_masks(grids: Floats, fitted: Fitted) -> Callable[[int], MaskGrid]:
    """Masks (n, h, w) of the whole input."""
    extent = input_extent(fitted)
    return lambda index: MaskGrid(grids[index], extent)


def _box_masks(grids: Floats, xyxy: Floats) -> Callable[[int], MaskGrid]:
    """Masks (n, h, w) of the boxes (n, 4) [px of the image] alone."""

    def mask(index: int) -> MaskGrid:
        x1, y1, x2, y2 = (float(side) for side in xyxy[index])
        return MaskGrid(grids[index], (x1, y1, x2, y2))

    return mask
