"""The truth of one search: hidden things in a home, and the camera's view of them.

All ways of searching meet the same truth and the same luck: whether a picture shows something is
drawn by a hash of what it is and from where it is looked at, not by the order of looking.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.freespace.grid import FreeSpace, visible_cells
from planner.search.viewpoints.candidate_views import Sensor, angle_between
from planner.search.viewpoints.candidate_views import square as square_of


class HiddenObject:
    """Instances of what is searched for, and how often each was looked at from where.

    A look from a square that something was not looked at from before shows it with the sensor's
    chance; one more look from there repeats the first with `rho`, and is drawn anew otherwise.
    """

    def __init__(self, space: FreeSpace, sensor: Sensor, cells: Sequence[int], seed: str) -> None:
        self.cells = tuple(cells)
        self._space, self._sensor, self._seed = space, sensor, seed
        self._seen: list[dict[int, tuple[float, float]]] = [
            _seen_from(space, sensor, cell) for cell in cells
        ]
        self._looks: Counter[tuple[int, int]] = Counter()

    def begin(self) -> None:
        """Forget all looks, for the next way of searching."""
        self._looks.clear()

    @property
    def views(self) -> NDArray[np.intp]:
        """(n,) cells that any instance can be seen from."""
        return np.array(sorted({cell for seen in self._seen for cell in seen}), np.intp)

    def shown(self, cell: int, heading: float, extent: float) -> bool:
        """Whether a look from `cell` about `heading`, `extent` wide [rad], shows any instance."""
        square = square_of(self._space, cell)
        found = False
        for number, seen in enumerate(self._seen):
            if cell not in seen:
                continue
            metres, bearing = seen[cell]
            if float(angle_between(bearing, heading)) > extent / 2 + 1e-9:
                continue
            found |= self._detected(number, square, float(self._sensor.chance(metres)))
            self._looks[number, square] += 1
        return found

    def _detected(self, number: int, square: int, chance: float) -> bool:
        before = self._looks[number, square]
        first = self._draw(number, square, "first") < chance
        if before == 0 or self._draw(number, square, f"repeats {before}") < self._sensor.rho:
            return first
        return self._draw(number, square, f"anew {before}") < chance

    def _draw(self, number: int, square: int, what: str) -> float:
        text = f"{self._seed} {number} {square} {what}"
        return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=7).digest()) / 2**56


def _seen_from(space: FreeSpace, sensor: Sensor, cell: int) -> dict[int, tuple[float, float]]:
    """Cells that `cell` is seen from within range: metres, and the bearing [rad] towards it."""
    cells, offset = visible_cells(space, cell, sensor.far)
    metres = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(-offset[:, 1], -offset[:, 0])
    within = metres >= sensor.near
    found = zip(cells[within], metres[within], bearing[within], strict=True)
    return {int(at): (float(far), float(angle)) for at, far, angle in found}
