"""Beliefs given by probabilities of rooms, for benchmarks and tests."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.grid import Cells, FreeSpace
from planner.search.belief import CellBelief


def room_weights(
    space: FreeSpace, cells: Cells, probabilities: Mapping[int, float] | ArrayLike
) -> NDArray[np.float64]:
    """(c,) each room's probability spread evenly over its cells."""
    rooms = space.room.reshape(-1)[cells]
    counts = np.bincount(rooms, minlength=int(rooms.max()) + 1)
    p = np.zeros(len(counts))
    if isinstance(probabilities, Mapping):
        for room, value in probabilities.items():
            p[room] = value
    else:
        given = np.asarray(probabilities, np.float64)
        p[: len(given)] = given[: len(counts)]
    return p[rooms] / counts[rooms]


def belief_from(
    cells: Cells, weights: ArrayLike, absent: float, *, everywhere: float = 0.02
) -> CellBelief:
    """A belief of `weights` (c,) in any scale, of which `everywhere` is spread over all cells.

    The even share keeps cells possible that a wrong prior excludes.
    """
    raw = np.asarray(weights, np.float64)
    even = np.full(len(raw), 1.0 / len(raw))
    total = float(raw.sum())
    shaped = even if total <= 0 else (1 - everywhere) * raw / total + everywhere * even
    return CellBelief(cells, shaped * (1 - absent), absent)
