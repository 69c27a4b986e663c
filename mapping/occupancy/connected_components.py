"""Connected components of a mask, by union of the runs of its rows, and dilation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def connected_components(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(nx, ny) number of the four-connected part each cell of `mask` belongs to, -1 elsewhere."""
    labels = np.full(mask.shape, -1, np.int64)
    parent: list[int] = []
    for x, row in enumerate(mask):
        for a, b in runs(row):
            labels[x, a:b] = len(parent)
            parent.append(len(parent))
            if x:
                for beside in np.unique(labels[x - 1, a:b][mask[x - 1, a:b]]):
                    parent[_root(parent, int(beside))] = _root(parent, len(parent) - 1)
    roots = [_root(parent, k) for k in range(len(parent))]
    number = np.unique(roots, return_inverse=True)[1]
    return np.append(number, -1).astype(np.int64)[labels]


def runs(row: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """(from, to) of each stretch of True in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    for a, b in edges.reshape(-1, 2):
        yield int(a), int(b)


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
