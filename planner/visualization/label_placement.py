"""Where to write labels so that none covers another: greedy, best of a few rings around each point.

All boxes are (xmin, ymin, xmax, ymax) in the same unit, pixels for a picture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Boxes = NDArray[np.float64]
Box = tuple[float, float, float, float]
#: boxes (k, 4) -> whether each lies over what is not to be written over, (k,) bool
Covers = Callable[[Boxes], NDArray[np.bool_]]

#: Directions to try, the better readable first: right, left, above, below, then the corners.
_DIRECTIONS = np.array(
    [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)], np.float64
)


@dataclass(frozen=True, slots=True)
class Label:
    """One label where it fits."""

    index: int  # of the point it belongs to
    box: Box
    distant: bool  # so far from its point that a line should lead there


def place_labels(
    points: ArrayLike,
    sizes: ArrayLike,
    obstacles: ArrayLike = (),
    *,
    bounds: Box,
    gap: float = 6.0,
    rings: int = 5,
    covers: Covers | None = None,
) -> tuple[Label, ...]:
    """Boxes for labels of `sizes` (n, 2) near `points` (n, 2); crowded ones that fit nowhere lack.

    No box overlaps another one or one of `obstacles` (m, 4), nor leaves `bounds`, nor lies where
    `covers` says so; points within half a `gap` of a box count as overlapped. Points with many
    neighbours are served first, of those with as many the first.
    """
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    wh = np.asarray(sizes, np.float64).reshape(-1, 2)
    dots = np.hstack([xy - gap / 2, xy + gap / 2])
    taken = _Taken(np.vstack([np.asarray(obstacles, np.float64).reshape(-1, 4), dots]), len(xy))
    placed = []
    for index in _crowded_first(xy, float(np.median(wh[:, 0])) if len(wh) else 0.0):
        for ring in range(rings):
            boxes = _around(xy[index], wh[index], gap * (1 + 1.5 * ring))
            free = _inside(boxes, bounds) & (~covers(boxes) if covers else True)
            boxes = boxes[free]
            boxes = boxes[~taken.overlap(boxes)]
            if len(boxes):
                box = boxes[0]
                taken.add(box)
                a, b, c, d = (float(v) for v in box)
                placed.append(Label(int(index), (a, b, c, d), ring > 0))
                break
    return tuple(sorted(placed, key=lambda label: label.index))


class _Taken:
    """Boxes that nothing may overlap; with room for `more`."""

    def __init__(self, boxes: Boxes, more: int) -> None:
        self._boxes, self._count = np.vstack([boxes, np.empty((more, 4))]), len(boxes)

    def add(self, box: Boxes) -> None:
        self._boxes[self._count] = box
        self._count += 1

    def overlap(self, boxes: Boxes) -> NDArray[np.bool_]:
        return overlapping(boxes, self._boxes[: self._count])


def overlapping(boxes: Boxes, taken: Boxes) -> NDArray[np.bool_]:
    """(k,) whether each of `boxes` (k, 4) overlaps one of `taken` (m, 4)."""
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    apart = np.any((taken[:, :2] >= high) | (taken[:, 2:] <= low), axis=2)
    return np.asarray(~np.all(apart, axis=1), np.bool_)


def _crowded_first(xy: Boxes, reach: float) -> NDArray[np.intp]:
    """Order of points by how many others lie in their square of `reach` and those around it."""
    squares = np.floor(xy / max(reach, 1e-9)).astype(np.int64)
    counts = Counter(map(tuple, squares.tolist()))
    around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    neighbours = [sum(counts[x + i, y + j] for i, j in around) for x, y in squares.tolist()]
    return np.argsort(-np.array(neighbours, np.int64), kind="stable")


def _around(point: Boxes, size: Boxes, gap: float) -> Boxes:
    """(k, 4) boxes that touch a ring of radius `gap` about `point`, in order of preference."""
    slanted = np.where(np.abs(_DIRECTIONS).sum(axis=1, keepdims=True) > 1, 0.75, 1.0)
    centre = point + _DIRECTIONS * (size / 2) + _DIRECTIONS * gap * slanted
    return np.hstack([centre - size / 2, centre + size / 2])


def _inside(boxes: Boxes, bounds: Box) -> NDArray[np.bool_]:
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    return np.asarray(((boxes[:, :2] >= low) & (boxes[:, 2:] <= high)).all(axis=1))
