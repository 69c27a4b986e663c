"""Heads that answer a short list of things, one box each, and need no suppression.

set prediction   exports of RT-DETR, D-FINE and DEIM with `orig_target_sizes`: labels, boxes (xyxy
                 in image pixels), scores
queries          DETR and its kin as trained: logits (Q, C), boxes (Q, 4) centre and size as shares
                 of the image; Carion et al. 2020 (arXiv 2005.12872), softmax over C - 1 classes and
                 "no object", later ones a sigmoid for each class; masks (Q, h, w) of logits
rows             YOLOv10 and later, and exports with suppression inside: x1, y1, x2, y2 [px of the
                 input], score, class, in this order or another, and of segmenting ones coefficients
                 of prototype masks
lists            boxes, labels, scores apart: torchvision's (labels from 1), EfficientNMS,
                 OpenMMLab's, TensorFlow's (shares of the image, y first), and of Mask R-CNN (He et
                 al. 2017, arXiv 1703.06870) probabilities, of the image or of each box
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.inference.heads.candidates import (
    Candidates,
    Floats,
    Head,
    Inputs,
    MaskGrid,
    Outputs,
    in_input,
    input_corner,
    input_extent,
    pairs_above,
)
from perception.inference.heads.dense import check_equal_length, corners_of, prototype_masks
from perception.inference.session import Fitted

_ROUNDING: Final = 1e-3
_MOST: Final = 10_000  # classes of a network
_BORDER: Final = 0.3  # share of the input by which boxes may lie outside


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPredictionHead(Head):
    """labels, boxes [px of the image], scores; a second input takes the image's size."""

    size_input: str
    outputs: tuple[str, ...] = ("labels", "boxes", "scores")
    name: str = "set-prediction"

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> Inputs:
        """The image, and its width and height."""
        size = np.array([[shape[1], shape[0]]], np.int64)
        return {self.image_input: fitted.tensor, self.size_input: size}

    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
        """The candidates above the threshold."""
        labels, boxes, scores = (output[0] for output in outputs)
        check_equal_length(boxes, scores, labels)
        return _listed(boxes, scores, labels, threshold)


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryHead(Head):
    """logits (Q, C), boxes (Q, 4) as shares of the image, and perhaps masks (Q, h, w)."""

    name: str = "queries"
    no_object: bool = False  # whether the last class is "no object", or of no label
    sigmoid: bool = False  # whether each class has a score of its own even so
    mask_input: tuple[str, tuple[int, ...]] | None = None  # of the mask of valid pixels

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> Inputs:
        """The image, and where the network asks for it a mask that takes all of it."""
        found: Inputs = {self.image_input: fitted.tensor}
        if self.mask_input is not None:
            name, size = self.mask_input
            found[name] = np.ones(size, np.int64)
        return found

    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
        """Every pair of query and class above the threshold."""
        logits, shares = (output.astype(np.float32)[0] for output in outputs[:2])
        check_equal_length(shares, logits)
        with np.errstate(over="ignore"):
            if self.no_object and not self.sigmoid:
                weight = np.exp(logits - logits.max(1, keepdims=True, initial=-np.inf))
                scores = (weight / weight.sum(1, keepdims=True))[:, :-1]
            else:
                scores = 1 / (1 + np.exp(-logits[:, :-1] if self.no_object else -logits))
        rows, classes = pairs_above(scores, threshold)
        x1, y1, x2, y2 = input_extent(fitted)
        corners = corners_of(shares[rows, :2], shares[rows, 2:])
        boxes = corners * np.array([x2 - x1, y2 - y1] * 2) + np.array([x1, y1] * 2)
        mask = None
        if len(outputs) > 2:
            grids = outputs[2].astype(np.float32)[0]
            if len(grids) != len(logits):
                raise ModelError(f"the network gives {len(grids)} masks for {len(logits)} queries")
            mask = _whole_masks(grids[rows], fitted)
        return Candidates(boxes.astype(np.float32), scores[rows, classes], classes, mask)


@dataclass(frozen=True, slots=True, kw_only=True)
class RowsHead(Head):
    """Rows (K, 6 + M) of finished detections, and with M > 0 prototypes (M, h, w).

    `order` has the columns of x1, y1, x2, y2, score and class.
    """

    order: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    name: str = "rows"
    size_inputs: tuple[str, ...] = ()  # of PaddleDetection: the input's size, the image's scale

    def inputs(self, fitted: Fitted, shape: tuple[int, int]) -> Inputs:
        """The image, and its scale and size where the network takes them."""
        known: Inputs = {
            "im_shape": np.array([fitted.tensor.shape[2:]], np.float32),
            "scale_factor": np.array([fitted.scale[::-1]], np.float32),
        }
        return {self.image_input: fitted.tensor} | {name: known[name] for name in self.size_inputs}

    def _rows(self, outputs: Outputs) -> Floats:
        rows = outputs[0].astype(np.float32)
        return rows[0] if rows.ndim == 3 else rows

    def fits(self, outputs: Outputs, fitted: Fitted, threshold: float) -> bool:
        """Whether scores are shares of 1, classes whole numbers and boxes in order."""
        rows = self._rows(outputs)[:, list(self.order)]
        score, label = rows[:, 4], rows[:, 5]
        known = label[score > 0]
        return bool(
            ((score <= 1 + _ROUNDING) & (score >= -1)).all()
            and not (self.first_label and np.isin(known, self.unused).any())
            and ((label == np.rint(label)) & (label >= -1) & (label < _MOST)).all()
            and (rows[:, 2:4] >= rows[:, :2]).all()
        )

    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
        """The candidates above the threshold."""
        whole = self._rows(outputs)
        whole = whole[whole[:, self.order[4]] > threshold]
        rows = whole[:, list(self.order)]
        mask = None
        if len(outputs) > 1:
            mask = prototype_masks(whole[:, 6:], outputs[1].astype(np.float32)[0], fitted)
        # a network that takes the scale of the image undoes it
        scaled = "scale_factor" in self.size_inputs
        boxes = rows[:, :4] if scaled else fitted.to_image(in_input(rows[:, :4], fitted))
        return Candidates(boxes, rows[:, 4], _whole_numbers(rows[:, 5]), mask)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListHead(Head):
    """boxes (n, 4) [px of the input, or shares of it], labels (n,), scores (n,), perhaps masks.

    Without scores the boxes are (n, 5), and the last column has them.
    """

    with_scores: bool = True
    down_first: bool = False  # whether boxes are y1, x1, y2, x2

    def _arrays(
        self, outputs: Outputs
    ) -> tuple[Floats, NDArray[np.generic], Floats, list[NDArray[np.generic]]]:
        """Boxes (n, 4), labels (n,), scores (n,), and masks of each."""
        boxes, labels, *rest = outputs
        first = boxes.astype(np.float32)
        if first.ndim == 3:
            first, rest = first[0], [one[0] for one in rest]
            labels = labels[0]
        labels = labels.reshape(-1) if labels.ndim > 1 else labels
        if self.with_scores:
            score = rest.pop(0).astype(np.float32)
            score = score.reshape(-1) if score.ndim > 1 else score
        else:
            first, score = first[:, :4], first[:, 4]
        check_equal_length(first, score, labels, *rest)
        return (first[:, [1, 0, 3, 2]] if self.down_first else first), labels, score, rest

    def fits(self, outputs: Outputs, fitted: Fitted, threshold: float) -> bool:
        """Whether labels begin with this one's first, and boxes are in order and in the image."""
        boxes, labels, score, _ = self._arrays(outputs)
        good = score > threshold
        within = in_input(boxes[good], fitted) <= input_corner(fitted) * np.float32(1 + _BORDER)
        label = _whole_numbers(labels.astype(np.float32)[good])
        ordered = boxes[good, 2:] >= boxes[good, :2]
        unused = self.first_label == 1 and np.isin(label, self.unused).any()
        return bool(within.all() and ordered.all() and (label >= 0).all() and not unused)

    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
        """The candidates above the threshold."""
        boxes, labels, scores, masks = self._arrays(outputs)
        found = _listed(boxes, scores, labels, threshold)
        chosen = np.nonzero(scores > threshold)[0]
        image = fitted.to_image(in_input(found.xyxy, fitted))
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
