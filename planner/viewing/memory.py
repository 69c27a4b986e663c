"""What has been looked at from where: a repeated look is worth less each time."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from planner.viewing.looks import Looks, square

Chances = NDArray[np.float32]


class Memory:
    """What n looks from a square metre showed is worth (1 - rho)^n of the next one from there.

    Most of what one look misses is hidden from there or not known to the detector, so that looking
    on and on from one spot never finds it; nor does looking from a step beside it.
    """

    def __init__(self, looks: Looks) -> None:
        self._looks = looks
        self._stands: dict[int, list[int]] = defaultdict(list)  # by square
        for stand, cell in enumerate(looks.stands):
            self._stands[square(looks.space, int(cell))].append(stand)
        self._squares = {stand: at for at, stands in self._stands.items() for stand in stands}
        self._worth: dict[int, Chances] = {}  # by square: (c,) what is left of a look

    def note(self, look: int) -> None:
        """Remember that `look` was taken."""
        self.note_shown(self._cell(look), self._looks.chance[look])

    def note_shown(self, cell: int, chance: Chances) -> None:
        """Remember a picture from floor `cell` that showed each cell with `chance` (c,)."""
        here = square(self._looks.space, cell)
        worth = self._worth.get(here)
        worth = np.ones(len(chance), np.float32) if worth is None else worth
        rest = np.float32(1 - self._looks.sensor.rho)
        self._worth[here] = np.where(chance > 0, worth * rest, worth)

    def chance(self, look: int) -> Chances:
        """(c,) chance of `look` to detect what all looks before it have missed."""
        return self.lessened(self._cell(look), self._looks.chance[look])

    def worn(self, stand: int) -> Chances | None:
        """(c,) what is left of looks from position `stand`; None where none was taken there."""
        return self._worth.get(self._squares[stand])

    def lessened(self, cell: int, chance: Chances) -> Chances:
        """`chance` (c,) of a picture from floor `cell`, after all looks before it."""
        worth = self._worth.get(square(self._looks.space, cell))
        return np.array(chance) if worth is None else chance * worth

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) how much each look finds of `weight` (c,)."""
        left = weight.astype(np.float32)
        gains = self._looks.chance @ left
        for here, worth in self._worth.items():
            for stand in self._stands.get(here, ()):
                rows = slice(*np.searchsorted(self._looks.stand, [stand, stand + 1]))
                gains[rows] = self._looks.chance[rows] @ (left * worth)
        return gains.astype(np.float64)

    def moved_to(self, looks: Looks) -> Memory:
        """The same memory for other `looks` over the same cells of a floor of the same grid."""
        other = Memory(looks)
        other._worth = dict(self._worth)
        return other

    def copy(self) -> Memory:
        """The same memory, to go on with on trial."""
        return self.moved_to(self._looks)

    def _cell(self, look: int) -> int:
        return int(self._looks.stands[self._looks.stand[look]])
