"""Where something may be: weights on cells of the floor.

One belief for everything that is known: a remembered site and the room around it are the same
cells, so that looking at the site in vain lowers the room, and nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.grid import Cells, FreeSpace


@dataclass(frozen=True, slots=True, eq=False)
class CellBelief:
    """Probability that what is searched for lies in each cell, and that it lies in none.

    `weight` sums to 1 - `absent`. Raises ValueError for negative or missing mass.
    """

    cells: Cells  # (c,)
    weight: NDArray[np.float64]  # (c,)
    absent: float  # probability that it is nowhere on this floor

    def __post_init__(self) -> None:
        total = float(self.weight.sum()) + self.absent
        if self.weight.min(initial=0.0) < 0 or self.absent < 0 or not np.isclose(total, 1.0):
            raise ValueError(f"weights must be 0 or more and sum to 1 with absent, got {total:g}")

    @property
    def present(self) -> float:
        """Probability that it is on this floor."""
        return 1.0 - self.absent

    def of_room(self, space: FreeSpace, room: int) -> float:
        """Probability that it is in `room`."""
        return float(self.weight[space.room.reshape(-1)[self.cells] == room].sum())


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


def site_weights(
    space: FreeSpace, cells: Cells, p_map: ArrayLike, sigma: float
) -> NDArray[np.float64]:
    """(c,) one unit of probability around `p_map` (2,) [m], Gaussian with `sigma` [m].

    A site off the floor (on a counter, in a wall) falls to the cells nearest to it.
    """
    off = ((space.centres(cells) - np.asarray(p_map, np.float64)[:2]) ** 2).sum(axis=1)
    log = -off / (2 * max(sigma, space.cell / 2) ** 2)
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum(), np.float64)


def belief_from(
    cells: Cells, weights: ArrayLike, absent: float, *, everywhere: float = 0.02
) -> CellBelief:
    """A belief of `weights` (c,) in any scale, of which `everywhere` is spread over all cells.

    The even share is what keeps a wrong prior from hiding anything for good.
    """
    raw = np.asarray(weights, np.float64)
    even = np.full(len(raw), 1.0 / len(raw))
    total = float(raw.sum())
    shaped = even if total <= 0 else (1 - everywhere) * raw / total + everywhere * even
    return CellBelief(cells, shaped * (1 - absent), absent)
