"""Binary masks of pixels or cells: components, distances, neighbours, runs; by OpenCV."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def connected_components(mask: Mask) -> NDArray[np.int64]:
    """(n, m) number of the four-connected component of each cell of `mask`, -1 elsewhere."""
    import cv2  # as late as possible: commands that need no masks start faster

    if not mask.size:
        return np.full(mask.shape, -1, np.int64)
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1].astype(np.int64) - 1


def distance_to_walls(inside: Mask, max_distance: int) -> NDArray[np.float64]:
    """Exact Euclidean distance [cells] of each cell of `inside` to the nearest that is not.

    Distances above `max_distance` cells are `max_distance`; beyond the border everything is wall.
    """
    import cv2

    padded = np.pad(inside, 1).astype(np.uint8)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    return np.minimum(distance, max_distance).astype(np.float64)


def with_neighbours(mask: Mask) -> Mask:
    """The cells of `mask` and their four neighbours."""
    import cv2

    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return cv2.dilate(mask.astype(np.uint8), cross).astype(np.bool_)


def runs(mask: Mask) -> NDArray[np.intp]:
    """(n, 3) row, first cell and end of each run of True in the rows of `mask`, in order."""
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    return np.column_stack([np.argwhere(edges == 1), np.argwhere(edges == -1)[:, 1]])
