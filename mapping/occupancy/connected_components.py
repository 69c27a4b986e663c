"""Connected components of a mask, by union of the runs of its rows, and dilation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def connected_components(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(nx, ny) number of the four-connected component of each cell of `mask`, -1 elsewhere."""
    labels = np.full(mask.shape, -1, np.int64)
    parent: list[int] = []
    for x, a, b in runs(mask).tolist():
        number = len(parent)
        labels[x, a:b] = number
        parent.append(number)
        if x:
            for beside in set(labels[x - 1, a:b].tolist()) - {-1}:
                parent[_root(parent, beside)] = _root(parent, number)
    roots = [_root(parent, k) for k in range(len(parent))]
    number_of = np.unique(roots, return_inverse=True)[1]
    return np.append(number_of, -1).astype(np.int64)[labels]


def runs(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(n, 3) row, first cell and end of each run of True in the rows of `mask`, in order."""
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    return np.column_stack([np.argwhere(edges == 1), np.argwhere(edges == -1)[:, 1]])


def _root(parent: list[int], k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


def neighbours(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The four neighbours of the cells of `mask` (nx, ny)."""
    found = np.zeros_like(mask)
    found[1:] |= mask[:-1]
    found[:-1] |= mask[1:]
    found[:, 1:] |= mask[:, :-1]
    found[:, :-1] |= mask[:, 1:]
    return found
