"""Occupancy grid tiles: log-odds of one storey's cells, in squares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import FREE, LOW, TALL, UNKNOWN
from mapping.occupancy.depth_projection import FloorEvidence
from mapping.occupancy.occupancy_settings import OccupancySettings

Key = tuple[int, int]  # number of a tile along x and y
States = NDArray[np.uint8]  # (side, side) cells (x, y): UNKNOWN, FREE, LOW or TALL

ViewTimes = NDArray[np.uint32]  # (2, m, m) [min since 1970] of the last view, close by and at all

_LAST_MINUTE: Final = 2**32 - 1
_MAX_TALL: Final = 9  # evidence that an obstacle is tall
_TALL_SEEN: Final = 3


def no_views(settings: OccupancySettings) -> ViewTimes:
    """Times of views of a tile that was never viewed."""
    larger = settings.side // settings.view
    return np.zeros((2, larger, larger), np.uint32)


class OccupancyTile:
    """Occupancy grid of one square: log-odds of an obstacle, its height, and times of views."""

    __slots__ = ("log_odds", "tall", "viewed")

    def __init__(
        self,
        settings: OccupancySettings,
        states: States | None = None,
        viewed: ViewTimes | None = None,
    ) -> None:
        shape = (settings.side, settings.side)
        self.viewed = no_views(settings) if viewed is None else viewed.copy()
        self.log_odds = np.zeros(shape, np.int16)
        self.tall = np.zeros(shape, np.int8)
        if states is not None:  # the log-odds behind written states are not kept
            self.log_odds[states == FREE] = settings.free - settings.miss
            self.log_odds[(states == LOW) | (states == TALL)] = settings.occupied + settings.hit
            self.tall[states == TALL] = _TALL_SEEN

    def add(self, evidence: TileEvidence, stamp: float, settings: OccupancySettings) -> None:
        """Add one frame's evidence; `stamp` [s since 1970]."""
        free, hit, tall = evidence.free, evidence.hit, evidence.tall
        minute = np.uint32(min(max(stamp / 60, 1), _LAST_MINUTE))
        np.maximum(self.viewed, evidence.viewed * minute, out=self.viewed)
        if evidence.views_only:
            return
        self.log_odds += hit * np.int16(settings.hit) - free * np.int16(settings.miss)
        np.clip(self.log_odds, settings.least, settings.most, out=self.log_odds)
        # one frame that shows the top outweighs a few that show the lower part alone
        self.tall += tall * np.int8(_TALL_SEEN + 1) - hit * np.int8(1)
        np.clip(self.tall, 0, _MAX_TALL, out=self.tall)

    def states(self, settings: OccupancySettings) -> States:
        """Classified cells: free, low, tall or unknown."""
        found = np.full(self.log_odds.shape, UNKNOWN, np.uint8)
        found[self.log_odds <= settings.free] = FREE
        occupied = self.log_odds >= settings.occupied
        found[occupied] = LOW
        found[occupied & (self.tall > 0)] = TALL
        return found


@dataclass(frozen=True, slots=True, eq=False)
class TileEvidence:
    """One frame's evidence of one tile."""

    free: NDArray[np.bool_]  # (side, side)
    hit: NDArray[np.bool_]
    tall: NDArray[np.bool_]
    viewed: NDArray[np.bool_]  # (2, side / view, side / view)
    views_only: bool  # whether there are views alone


def tile_evidence(
    frame: FloorEvidence, settings: OccupancySettings
) -> Iterator[tuple[Key, TileEvidence]]:
    """Evidence of a frame by tile, for each tile with any."""
    side, larger = settings.side, settings.side // settings.view
    known = frame.free | frame.hit
    count = len(known) // side
    touched = np.asarray(known.reshape(count, side, count, side).any(axis=(1, 3)))
    seen = frame.viewed[1].reshape(count, larger, count, larger).any(axis=(1, 3))
    for i, j in np.argwhere(touched | seen):
        part = slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side)
        rows, columns = slice(i * larger, (i + 1) * larger), slice(j * larger, (j + 1) * larger)
        viewed = frame.viewed[:, rows, columns]
        key = (frame.tile[0] + int(i), frame.tile[1] + int(j))
        views_only = not bool(touched[int(i), int(j)])
        yield (
            key,
            TileEvidence(frame.free[part], frame.hit[part], frame.tall[part], viewed, views_only),
        )


def view_evidence(
    p_map: NDArray[np.float64], close: NDArray[np.bool_], settings: OccupancySettings
) -> Iterator[tuple[Key, NDArray[np.bool_]]]:
    """Larger cells in view by tile, (2, m, m) as `TileEvidence.viewed`.

    `p_map` (n, 2) [m] are points on the floor, `close` (n,) whether each was viewed from close by.
    """
    larger = settings.side // settings.view
    cells = np.floor(p_map / (settings.cell * settings.view)).astype(np.intp)
    tiles, within = np.divmod(cells, larger)
    first = tiles.min(axis=0, initial=0)
    shape = tiles.max(axis=0, initial=0) - first + 1
    viewed = np.zeros((*shape, 2, larger, larger), np.bool_)
    tile, cell = tuple((tiles - first).T), tuple(within.T)
    viewed[(*tile, 1, *cell)] = True
    tile, cell = tuple((tiles - first)[close].T), tuple(within[close].T)
    viewed[(*tile, 0, *cell)] = True
    for i, j in np.argwhere(viewed.any(axis=(2, 3, 4))):
        yield (int(first[0] + i), int(first[1] + j)), viewed[i, j]


def views_of_known(
    viewed: NDArray[np.bool_], states: States, settings: OccupancySettings
) -> TileEvidence:
    """Evidence of views alone (2, m, m), of larger cells that have a known cell."""
    side, view = settings.side, settings.view
    larger = side // view
    known = (states != UNKNOWN).reshape(larger, view, larger, view).any(axis=(1, 3))
    nothing = np.zeros_like(states, np.bool_)
    return TileEvidence(nothing, nothing, nothing, viewed & known, views_only=True)
