"""Evidence about one storey's floor, cell by cell, in square tiles: an occupancy grid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.records import FREE, LOW, TALL, UNKNOWN
from mapping.floor.settings import FloorSettings
from mapping.floor.sweep import Sweep

Key = tuple[int, int]  # number of a tile along x and y
States = NDArray[np.uint8]  # (side, side) cells (x, y): UNKNOWN, FREE, LOW or TALL

_TALLEST: Final = 9  # of the evidence that something is tall
_TALL_SEEN: Final = 3


class Tile:
    """The cells of one square: log-odds that something stands there, and how tall it seems."""

    __slots__ = ("log_odds", "tall")

    def __init__(self, settings: FloorSettings, states: States | None = None) -> None:
        shape = (settings.side, settings.side)
        self.log_odds = np.zeros(shape, np.int16)
        self.tall = np.zeros(shape, np.int8)
        if states is not None:  # of what was written before, no more is known than this
            self.log_odds[states == FREE] = settings.free - settings.miss
            self.log_odds[(states == LOW) | (states == TALL)] = settings.occupied + settings.hit
            self.tall[states == TALL] = _TALL_SEEN

    def add(
        self,
        free: NDArray[np.bool_],
        hit: NDArray[np.bool_],
        tall: NDArray[np.bool_],
        settings: FloorSettings,
    ) -> None:
        """Take in one frame's evidence, (side, side) each."""
        self.log_odds += hit * np.int16(settings.hit) - free * np.int16(settings.miss)
        np.clip(self.log_odds, settings.least, settings.most, out=self.log_odds)
        # what reaches above the eyes outweighs a few frames that show its lower part only
        self.tall += tall * np.int8(_TALL_SEEN + 1) - hit * np.int8(1)
        np.clip(self.tall, 0, _TALLEST, out=self.tall)

    def states(self, settings: FloorSettings) -> States:
        """What to believe of each cell."""
        found = np.full(self.log_odds.shape, UNKNOWN, np.uint8)
        found[self.log_odds <= settings.free] = FREE
        occupied = self.log_odds >= settings.occupied
        found[occupied] = LOW
        found[occupied & (self.tall > 0)] = TALL
        return found


def evidence(
    sweep: Sweep, settings: FloorSettings
) -> Iterator[tuple[Key, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]]:
    """The tiles a sweep says anything of, with their part of what is free, hit and tall."""
    side = settings.side
    said = sweep.free | sweep.hit
    count = len(said) // side
    touched = said.reshape(count, side, count, side).any(axis=(1, 3))
    for i, j in np.argwhere(touched):
        part = slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side)
        key = (sweep.tile[0] + int(i), sweep.tile[1] + int(j))
        yield key, sweep.free[part], sweep.hit[part], sweep.tall[part]
