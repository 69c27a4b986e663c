"""The raw head of YOLOX networks as their authors publish them: offsets on a grid, to be decoded.

Ge et al., "YOLOX: Exceeding YOLO series in 2021" (arXiv 2107.08430): each cell of grids of stride
8, 16 and 32 px predicts a centre relative to its corner, the logarithm of a size (in strides), an
objectness and a score for each class.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STRIDES = (8, 16, 32)  # [px of the input]
BOX = 5  # numbers before the class scores: centre x, y, size w, h, objectness


def cells(height: int, width: int) -> int:
    """How many cells the grids of an input of that size [px] have."""
    return sum((height // s) * (width // s) for s in STRIDES)


def decode(
    raw: NDArray[np.float32], height: int, width: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Boxes (n, 4) xyxy [px of the input] and scores (n, C) from a raw head (n, 5 + C)."""
    grids, strides = [], []
    for stride in STRIDES:
        row, column = np.mgrid[0 : height // stride, 0 : width // stride]
        grids.append(np.stack([column.ravel(), row.ravel()], axis=1))
        strides.append(np.full((row.size, 1), stride))
    grid, stride_of = np.concatenate(grids), np.concatenate(strides)
    centre = (raw[:, :2] + grid) * stride_of
    half = np.exp(raw[:, 2:4]) * stride_of / 2
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    return boxes.astype(np.float32), raw[:, 4:5] * raw[:, BOX:]
