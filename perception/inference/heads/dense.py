"""Dense heads: a box and a score for each class at every cell of grids over the image.

YOLOX        Ge et al. 2021 (arXiv 2107.08430): centre relative to the cell's corner and logarithm
             of a size, in strides; objectness; classes
NanoDet      distances of the four sides in strides, each the mean of a distribution over 8 values
             (Li et al. 2020, arXiv 2006.04388); classes before them
YOLOv5, v7   centre and size [px of the input], objectness, classes
YOLOv8, 11   centre and size [px of the input], classes, and of segmenting ones coefficients of
             prototype masks (Bolya et al. 2019, arXiv 1904.02689); a column for each cell
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from perception.inference.heads.candidates import (
    Candidates,
    Floats,
    Head,
    MaskGrid,
    Outputs,
    are_shares,
    in_input,
    input_corner,
    input_extent,
    pairs_above,
)
from perception.inference.session import Fitted

STRIDES: Final = (8, 16, 32)  # [px of the input]
PLUS_STRIDES: Final = (8, 16, 32, 64)  # of NanoDet-Plus
BOX: Final = 5  # numbers before the classes in YOLOX: centre, size, objectness
BINS: Final = 8  # of a side's distribution in NanoDet

REAL: Final = 0.9  # share of a network's boxes that are boxes in its input ...
OUTSIDE: Final = 0.6  # ... or so far outside, in its sides ...
MIN_SIDE: Final = 1.0  # ... with sides of so many pixels
MANY: Final = 20  # boxes that tell whether they are corners
FOLLOWS: Final = 0.8  # correlation of boxes with the cells that answer them
BESIDE: Final = 0.35  # of their sides, in the middle, by which no centres lie beside their cells
HIGHEST: Final = 100.0  # scores above 1 are refused with a line of their own
_ROUNDING: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Dense:
    """Output of a dense head for n cells."""

    xyxy: Floats  # (n, 4) [px of the input]
    scores: Floats  # (n, C)
    coefficients: Floats | None = None  # (n, M) of prototype masks


@dataclass(frozen=True, slots=True, kw_only=True)
class DenseHead(Head):
    """A head that is read by `decode`; the last output may be prototypes of masks [1, M, h, w]."""

    decode: Callable[[list[Floats]], Dense]
    objectness: bool = False  # whether a column of it, which is no constant, tells this head
    background: int | None = None  # its column among the scores of the second output
    shares: bool | None = None  # whether boxes are shares of the input; None: either
    named: bool = False  # whether names tell what is in which output
    corners: bool | None = None  # whether rows begin with x1, y1, x2, y2; None: all one
    overlapping: bool = True

    def fits(self, outputs: Outputs, fitted: Fitted, threshold: float) -> bool:
        """Whether nearly all boxes lie in the input, and scores are shares of 1."""
        arrays = [output.astype(np.float32)[0] for output in outputs]
        with np.errstate(all="ignore"):
            found = self.decode(arrays)
        raw = arrays[0]
        if self.objectness and len(raw) and np.ptp(raw[:, 4]) == 0:
            return False
        if self.background is not None:
            mean = arrays[1].mean(axis=0)
            if mean[self.background] < mean.max():
                return False
        size = input_corner(fitted)
        good = np.isfinite(found.xyxy).all(axis=1) & np.isfinite(found.scores).all(axis=1)
        empty = (found.scores == 0).all(axis=1) & (found.xyxy[:, :2] == found.xyxy[:, 2:]).all(
            axis=1
        )
        good &= ~empty
        boxes, scores = in_input(found.xyxy[good], fitted), found.scores[good]
        if not len(boxes):
            return True  # nothing tells
        if self.shares is not None and are_shares(found.xyxy) != self.shares:
            return False
        sides = boxes[:, 2:] - boxes[:, :2]
        if _beside_cells(boxes, *fitted.tensor.shape[2:]):
            return False
        if self.named:
            return len(boxes) < MANY or bool((sides >= 0).all(axis=1).mean() >= REAL)
        # of centres and sizes some are in another order than corners
        first = boxes[:, :2] * np.float32(1 if self.corners else 3)
        ordered = bool((boxes[:, 2:] > first).all(axis=1).mean() >= REAL)
        if self.corners is not None and len(boxes) > 1 and ordered != self.corners:
            return False
        inside = ((boxes > -OUTSIDE * size) & (boxes < (1 + OUTSIDE) * size)).all(axis=1)
        real = inside & (sides >= MIN_SIDE).all(axis=1)
        return bool(real.mean() >= REAL and scores.min() >= -_ROUNDING and scores.max() <= HIGHEST)

    def candidates(self, outputs: Outputs, fitted: Fitted, threshold: float) -> Candidates:
        """Every pair of box and class above the threshold."""
        arrays = [output.astype(np.float32)[0] for output in outputs]
        with np.errstate(all="ignore"):
            found = self.decode(arrays)
        check_equal_length(found.xyxy, found.scores)
        # a box that is not finite would suppress every other: nan compares as overlapping
        usable = np.isfinite(found.xyxy).all(axis=1, keepdims=True)
        rows, classes = pairs_above(np.where(usable, found.scores, 0), threshold)
        mask = None
        if found.coefficients is not None:
            mask = prototype_masks(found.coefficients[rows], arrays[-1], fitted)
        boxes = fitted.to_image(in_input(found.xyxy, fitted)[rows])
        return Candidates(boxes, found.scores[rows, classes], classes, mask)


def check_equal_length(boxes: NDArray[Any], *others: NDArray[Any]) -> None:
    """Raises ModelError where an output has not one row for each box (n, 4)."""
    shapes = [boxes.shape, *(other.shape for other in others)]
    if boxes.ndim != 2 or any(not s or s[0] != len(boxes) for s in shapes) or shapes[0][1] != 4:
        raise ModelError(
            f"the network gives outputs of shapes {', '.join(map(str, shapes))}; "
            "boxes (n, 4) and as many scores and labels would work"
        )


def prototype_masks(
    coefficients: Floats, prototypes: Floats, fitted: Fitted
) -> Callable[[int], MaskGrid]:
    """Masks that are sums of prototypes (M, h, w), weighted by coefficients (n, M)."""
    extent = input_extent(fitted)

    def mask(index: int) -> MaskGrid:
        return MaskGrid(np.tensordot(coefficients[index], prototypes, axes=1), extent)

    return mask


def cells(height: int, width: int, strides: tuple[int, ...] = STRIDES) -> int:
    """Number of cells of the grids of an input of that size [px]."""
    return sum(-(-height // s) * -(-width // s) for s in strides)


def _grid(height: int, width: int, strides: tuple[int, ...]) -> tuple[Floats, Floats]:
    """(n, 2) column and row of each cell, and (n, 1) its stride [px of the input]."""
    grids, sizes = [], []
    for stride in strides:
        row, column = np.mgrid[0 : -(-height // stride), 0 : -(-width // stride)]
        grids.append(np.stack([column.ravel(), row.ravel()], axis=1))
        sizes.append(np.full((row.size, 1), stride))
    return np.concatenate(grids).astype(np.float32), np.concatenate(sizes).astype(np.float32)


def _beside_cells(boxes: Floats, height: int, width: int) -> bool:
    """Whether boxes (n, 4) [px of the input] follow the cells of a grid, but not lie at them.

    Boxes of corners, of sizes or with y first, which are read in another way, lie beside theirs.
    """
    levels = [_grid(height, width, (stride,)) for stride in STRIDES]
    anchors = len(boxes) // cells(height, width)
    if anchors not in (1, 3) or len(boxes) != anchors * cells(height, width):
        return False
    places = [np.tile((at + np.float32(0.5)) * stride, (anchors, 1)) for at, stride in levels]
    cell, centre = np.concatenate(places), (boxes[:, :2] + boxes[:, 2:]) / 2
    with np.errstate(all="ignore"):
        alike = np.abs(np.corrcoef(cell.T, centre.T)[:2, 2:])
        off = np.median((centre - cell) / (boxes[:, 2:] - boxes[:, :2]), axis=0)
    straight, across = alike.diagonal().min(), alike[::-1].diagonal().min()
    if max(straight, across) < FOLLOWS:
        return False
    return bool(across > straight or (np.abs(off) > BESIDE).all())


def corners_of(centre: Floats, size: Floats) -> Floats:
    """Corners (n, 4) xyxy of boxes by centre and size (n, 2)."""
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)


def yolox(height: int, width: int) -> Callable[[list[Floats]], Dense]:
    """Decoder of rows (n, 5 + C) as YOLOX publishes them."""
    grid, stride = _grid(height, width, STRIDES)

    def decode(outputs: list[Floats]) -> Dense:
        raw = outputs[0]
        size = np.exp(np.minimum(raw[:, 2:4], 20)) * stride
        boxes = corners_of((raw[:, :2] + grid) * stride, size)
        return Dense(boxes, raw[:, 4:5] * raw[:, BOX:])

    return decode


def nanodet(height: int, width: int, strides: tuple[int, ...]) -> Callable[[list[Floats]], Dense]:
    """Decoder of rows (n, C + 32); cells of NanoDet-Plus (four strides) lie at their corners."""
    grid, stride = _grid(height, width, strides)
    middle = 0.0 if strides == PLUS_STRIDES else 0.5
    steps = np.arange(BINS, dtype=np.float32)

    def decode(outputs: list[Floats]) -> Dense:
        raw = outputs[0]
        bins = raw[:, -4 * BINS :].reshape(len(raw), 4, BINS)
        weight = np.exp(bins - bins.max(2, keepdims=True))
        sides = (weight / weight.sum(2, keepdims=True)) @ steps * stride
        centre = (grid + middle) * stride
        boxes = np.concatenate([centre - sides[:, :2], centre + sides[:, 2:]], axis=1)
        return Dense(boxes, raw[:, : -4 * BINS])

    return decode


def decoded(*, corners: bool = False, objectness: bool = False) -> Callable[[list[Floats]], Dense]:
    """Decoder of rows (n, 4 + C), or (n, 5 + C) with objectness, of finished boxes.

    These are corners, or centre and size.
    """

    def decode(outputs: list[Floats]) -> Dense:
        raw = outputs[0]
        boxes = raw[:, :4] if corners else corners_of(raw[:, :2], raw[:, 2:4])
        scores = raw[:, 4:5] * raw[:, BOX:] if objectness else raw[:, 4:]
        return Dense(boxes, scores)

    return decode


def yolo_v8(prototypes: int) -> Callable[[list[Floats]], Dense]:
    """Decoder of columns (4 + C + `prototypes`, n): centre, size, classes, mask coefficients."""

    def decode(outputs: list[Floats]) -> Dense:
        raw = outputs[0].T
        last = raw.shape[1] - prototypes
        coefficients = raw[:, last:] if prototypes else None
        return Dense(corners_of(raw[:, :2], raw[:, 2:4]), raw[:, 4:last], coefficients)

    return decode
