"""What has been looked at from where: a repeated look is worth less each time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.viewing.looks import Looks

Chances = NDArray[np.float32]


class Memory:
    """What n looks from a position showed is worth (1 - rho)^n of the next one from there.

    Most of what one look misses is hidden from there or not known to the detector, so that looking
    on and on from one spot never finds it.
    """

    def __init__(self, looks: Looks, least: float = 0.0) -> None:
        self._looks = looks
        self._least = least  # looks that find less are taken to find nothing
        self._worth: dict[int, Chances] = {}  # by position: (c,) what is left of a look

    def note(self, look: int) -> None:
        """Remember that `look` was taken."""
        self.note_shown(int(self._looks.stand[look]), self._looks.chance[look])

    def note_shown(self, stand: int, chance: Chances) -> None:
        """Remember a picture from about position `stand` that showed cells with `chance` (c,)."""
        worth = self._worth.get(stand)
        worth = np.ones(len(chance), np.float32) if worth is None else worth
        rest = np.float32(1 - self._looks.sensor.rho)
        self._worth[stand] = np.where(chance > 0, worth * rest, worth)

    def chance(self, look: int) -> Chances:
        """(c,) chance of `look` to detect what all looks before it have missed."""
        return self.lessened(int(self._looks.stand[look]), self._looks.chance[look])

    def lessened(self, stand: int, chance: Chances) -> Chances:
        """`chance` (c,) of a picture from about position `stand`, after all looks before it."""
        worth = self._worth.get(stand)
        return np.array(chance) if worth is None else chance * worth

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) how much each look finds of `weight` (c,)."""
        left = weight.astype(np.float32)
        gains = self._looks.chance @ left
        for stand, worth in self._worth.items():
            rows = slice(*np.searchsorted(self._looks.stand, [stand, stand + 1]))
            gains[rows] = self._looks.chance[rows] @ (left * worth)
        return np.where(gains >= self._least, gains, 0.0).astype(np.float64)

    def moved_to(self, looks: Looks, least: float) -> Memory:
        """The same memory for other `looks` over the same cells, of the positions that remain."""
        other = Memory(looks, least)
        now = {int(cell): stand for stand, cell in enumerate(looks.stands)}
        for stand, worth in self._worth.items():
            cell = int(self._looks.stands[stand])
            if cell in now:
                other._worth[now[cell]] = worth
        return other

    def copy(self) -> Memory:
        """The same memory, to go on with on trial."""
        other = Memory(self._looks, self._least)
        other._worth = dict(self._worth)  # its arrays are replaced, never written to
        return other
