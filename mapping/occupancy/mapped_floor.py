"""Mapped floor: the occupancy grid of one storey, assembled from its tiles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import FREE, LOW, TALL, UNKNOWN, FloorTile

_MAX_CAMERA_HEIGHT: Final = 2.4  # [m] above its floor
_CELLS: Final = (0.001, 1.0)  # [m] least and greatest side of a cell
_REACH: Final = 4096  # greatest distance of a kept cell from the middle [cells]: 205 m
_MAX_TILE: Final = 10**9  # number of a tile

States = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class MappedFloor:
    """Grid of the states of one storey's floor."""

    origin: NDArray[np.float64]  # (2,) [m] in the map frame: the corner of cell (0, 0)
    resolution: float  # [m] side of a cell
    states: States  # (nx, ny) UNKNOWN, FREE, LOW or TALL
    storey: int = 0
    span: float = 3.2  # [m] side of a tile

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) [m] the least and the greatest corner of what is known."""
        at = np.argwhere(self.states != UNKNOWN)
        return self.origin + np.array([at.min(axis=0), at.max(axis=0) + 1]) * self.resolution

    def cropped(self) -> MappedFloor:
        """The same floor without rows and columns of unknown cells, but for one around it all."""
        low, high = np.rint((self.bounds - self.origin) / self.resolution).astype(int)
        states = self.states[low[0] : high[0], low[1] : high[1]]
        return replace(
            self,
            origin=self.origin + (low - 1) * self.resolution,
            states=np.pad(states, 1, constant_values=UNKNOWN),
        )

    @property
    def areas(self) -> tuple[float, float]:
        """[m^2] of free and of occupied floor."""
        cell = self.resolution**2
        free = int((self.states == FREE).sum()) * cell
        return free, int(np.isin(self.states, (LOW, TALL)).sum()) * cell

    def tile_at(self, p_map: NDArray[np.float64]) -> tuple[int, int]:
        """Column and row of the tile that holds `p_map` (2,) [m]."""
        column, row = (int(n) for n in np.floor(np.asarray(p_map)[:2] / self.span + 1e-9))
        return column, row


@dataclass(frozen=True, slots=True, eq=False)
class FloorView:
    """Cells of a floor that a camera had in view."""

    p_map: NDArray[np.float64]  # (n, 2) [m] their middles
    metres: NDArray[np.float64]  # (n,) [m] their distance
    cell: float  # [m] their side


def mapped_floor(
    tiles: Iterable[FloorTile], height: float | None = None, *, storey: int | None = None
) -> MappedFloor | None:
    """Floor of a `storey`; by default that below `height` [m] of a camera, else the largest.

    None where no tile has a free cell there.
    """
    tiles = [tile for tile in tiles if storey in (None, tile.storey) and _usable(tile)]
    storeys: dict[int, list[FloorTile]] = {}
    for tile in tiles:
        storeys.setdefault(tile.storey, []).append(tile)
    area = {n: sum(int((t.cells == FREE).sum()) for t in held) for n, held in storeys.items()}
    known = [n for n in storeys if area[n]]
    if not known:
        return None
    above = {n: (height or 0.0) - storeys[n][0].height for n in known}
    near = [n for n in known if height is not None and 0 <= above[n] <= _MAX_CAMERA_HEIGHT]
    chosen = min(near, key=lambda n: (above[n], n)) if near else max(known, key=lambda n: area[n])
    return _put_together(storeys[chosen])


def _put_together(tiles: Sequence[FloorTile]) -> MappedFloor:
    """Grid of the tiles that share the cell size and side of most free floor.

    Tiles far from the middle of the others are left out, since a graph may hold a tile anywhere.
    """
    free = {id(tile): int((tile.cells == FREE).sum()) for tile in tiles}
    cuts = Counter[tuple[int, float]]()
    for tile in tiles:
        cuts[_cut(tile)] += free[id(tile)]
    (side, size), _ = cuts.most_common(1)[0]
    alike = [tile for tile in tiles if _cut(tile) == (side, size)]
    near = _about_the_middle(alike, [tile for tile in alike if free[id(tile)]], _REACH // side)
    low = np.min([(t.column, t.row) for t in near], axis=0)
    high = np.max([(t.column, t.row) for t in near], axis=0)
    states = np.full(tuple((high - low + 1) * side), UNKNOWN, np.uint8)
    for tile in near:
        i, j = (np.array([tile.column, tile.row]) - low) * side
        states[i : i + side, j : j + side] = tile.cells
    return MappedFloor(low * side * size, size, states, near[0].storey, side * size)


def _cut(tile: FloorTile) -> tuple[int, float]:
    return len(tile.cells), tile.resolution


def _about_the_middle(
    tiles: Iterable[FloorTile], centre: Sequence[FloorTile], reach: int
) -> list[FloorTile]:
    """The `tiles` up to `reach` tiles from the middle one of `centre`."""
    x, y = (sorted(n)[len(centre) // 2] for n in zip(*map(_number, centre), strict=True))
    middle = min(centre, key=lambda t: (abs(t.column - x) + abs(t.row - y), _number(t)))
    return [
        tile
        for tile in tiles
        if max(abs(tile.column - middle.column), abs(tile.row - middle.row)) <= reach
    ]


def _number(tile: FloorTile) -> tuple[int, int]:
    return tile.column, tile.row


def _usable(tile: FloorTile) -> bool:
    near = max(abs(tile.column), abs(tile.row)) <= _MAX_TILE
    return near and _CELLS[0] <= tile.resolution <= _CELLS[1]
