"""Where to write labels so that none covers another: greedy, best of a few rings around each point.

All boxes are (xmin, ymin, xmax, ymax) in the same unit, pixels for a picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Boxes = NDArray[np.float64]
Box = tuple[float, float, float, float]

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
) -> tuple[Label, ...]:
    """Boxes for labels of `sizes` (n, 2) near `points` (n, 2); crowded ones that fit nowhere lack.

    No box overlaps another one or one of `obstacles` (m, 4), nor leaves `bounds`; points within
    half a `gap` of a box count as overlapped. Points with few neighbours are served last.
    """
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    wh = np.asarray(sizes, np.float64).reshape(-1, 2)
    dots = np.hstack([xy - gap / 2, xy + gap / 2])
    taken = np.vstack([np.asarray(obstacles, np.float64).reshape(-1, 4), dots])
    placed = []
    for index in _crowded_first(xy, float(np.median(wh[:, 0])) if len(wh) else 0.0):
        for ring in range(rings):
            candidates = _around(xy[index], wh[index], gap * (1 + 1.5 * ring))
            free = [c for c in candidates if _inside(c, bounds) and not _overlaps(c, taken)]
            if free:
                taken = np.vstack([taken, free[0]])
                a, b, c, d = (float(v) for v in free[0])
                placed.append(Label(int(index), (a, b, c, d), ring > 0))
                break
    return tuple(sorted(placed, key=lambda label: label.index))


def _crowded_first(xy: Boxes, reach: float) -> NDArray[np.intp]:
    apart = np.linalg.norm(xy[:, None] - xy[None, :], axis=2)
    neighbours = (apart < max(reach, 1e-9)).sum(axis=1)
    return np.asarray(np.argsort(-neighbours, kind="stable"), np.intp)


def _around(point: Boxes, size: Boxes, gap: float) -> Boxes:
    """(k, 4) boxes that touch a ring of radius `gap` about `point`, in order of preference."""
    slanted = np.where(np.abs(_DIRECTIONS).sum(axis=1, keepdims=True) > 1, 0.75, 1.0)
    centre = point + _DIRECTIONS * (size / 2) + _DIRECTIONS * gap * slanted
    return np.hstack([centre - size / 2, centre + size / 2])


def _inside(box: Boxes, bounds: Box) -> bool:
    return bool(
        box[0] >= bounds[0] and box[1] >= bounds[1] and box[2] <= bounds[2] and box[3] <= bounds[3]
    )


def _overlaps(box: Boxes, taken: Boxes) -> bool:
    apart = (
        (taken[:, 0] >= box[2])
        | (taken[:, 2] <= box[0])
        | (taken[:, 1] >= box[3])
        | (taken[:, 3] <= box[1])
    )
    return not bool(apart.all())
