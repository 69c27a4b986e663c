"""Association of two streams by their stamps."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

TOLERANCE: Final = 0.02  # [s] within which two stamps are taken for one moment


def nearest_pairs(
    a: NDArray[np.float64], b: NDArray[np.float64], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs (i, j) with |a[i] - b[j]| <= `tolerance` [s], nearest pair first, each used once."""
    order = np.argsort(b, kind="stable")
    sorted_b = b[order]
    first = np.searchsorted(sorted_b, a - tolerance, "left")
    last = np.searchsorted(sorted_b, a + tolerance, "right")
    counts = last - first
    i = np.repeat(np.arange(len(a)), counts)
    within = np.arange(len(i)) - np.repeat(np.cumsum(counts) - counts, counts)
    j = order[np.repeat(first, counts) + within]
    pairs: list[tuple[int, int]] = []
    used_a, used_b = np.zeros(len(a), bool), np.zeros(len(b), bool)
    for k in np.lexsort((j, i, np.abs(a[i] - b[j]))):
        if not used_a[i[k]] and not used_b[j[k]]:
            used_a[i[k]] = used_b[j[k]] = True
            pairs.append((int(i[k]), int(j[k])))
    return pairs
