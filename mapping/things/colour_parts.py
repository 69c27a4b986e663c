"""Parts of one colour among joined voxels, by the graph segmentation of Felzenszwalb (2004).

Efficient Graph-Based Image Segmentation, IJCV 59(2): neighbours are joined in the order of their
difference, as long as it is not clearly larger than the differences within both of their parts.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_DIFFERENCE: Final = 300.0  # of colours (CIE Lab), divided by its voxels, that a part allows more
_LEAST: Final = 20  # voxels of a part

Pairs = NDArray[np.intp]


def colour_parts(lab: NDArray[np.float32], one: Pairs, other: Pairs) -> NDArray[np.int64]:
    """(n,) numbers, from 0, of the parts of voxels with colours `lab` (n, 3) in CIE Lab.

    `one` (m,) and `other` (m,) are the pairs of neighbours. Parts too small join a neighbour.
    """
    apart = np.linalg.norm(lab[one] - lab[other], axis=1)
    order = np.argsort(apart, kind="stable")
    pairs = list(
        zip(one[order].tolist(), other[order].tolist(), apart[order].tolist(), strict=True)
    )
    first, voxels = list(range(len(lab))), [1] * len(lab)
    allowed = [_DIFFERENCE] * len(lab)

    def part(voxel: int) -> int:
        while first[voxel] != voxel:
            first[voxel] = voxel = first[first[voxel]]
        return voxel

    def join(a: int, b: int) -> None:
        first[b] = a
        voxels[a] += voxels[b]

    for left, right, difference in pairs:
        a, b = part(left), part(right)
        if a != b and difference <= min(allowed[a], allowed[b]):
            join(a, b)
            allowed[a] = difference + _DIFFERENCE / voxels[a]
    for left, right, _ in pairs:
        a, b = part(left), part(right)
        if a != b and min(voxels[a], voxels[b]) < _LEAST:
            join(a, b)
    parts = [part(voxel) for voxel in range(len(lab))]
    return np.unique(parts, return_inverse=True)[1].astype(np.int64)
