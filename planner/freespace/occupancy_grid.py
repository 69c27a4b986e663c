"""Free space from an occupancy grid: a coarser grid whose walls still hold, rooms by rectangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import LayoutError
from perception.binary_masks import connected_components
from planner.freespace.grid import CELL, NO_ROOM, FreeSpace, Room

_MAX_CELLS: Final = 4e5  # of a free space; larger buildings get larger cells
_MIN_RESOLUTION: Final = 0.01  # [m] finer cells would be put together by the hundreds
_MAX_RESOLUTION: Final = 10.0  # [m]
_ISLAND: Final = 1.0  # [m^2] less floor than this, cut off from the rest, is noise


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Occupancy grid of a mapping robot's range finder.

    Raises LayoutError where the parts do not fit.
    """

    free: NDArray[np.bool_]  # (nx, ny)
    occupied: NDArray[np.bool_]  # (nx, ny); what is neither is unknown
    origin: NDArray[np.float64]  # (2,) [m] in the map frame: the corner of cell (0, 0)
    resolution: float  # [m] side of a cell

    def __post_init__(self) -> None:
        if self.free.ndim != 2 or self.free.shape != self.occupied.shape:
            raise LayoutError(
                f"free and occupied must both be (nx, ny), got {self.free.shape} and "
                f"{self.occupied.shape}"
            )
        if not _MIN_RESOLUTION <= self.resolution <= _MAX_RESOLUTION:
            raise LayoutError(
                f"the resolution must be {_MIN_RESOLUTION:g} to {_MAX_RESOLUTION:g} m, "
                f"got {self.resolution:g}"
            )
        if np.shape(self.origin) != (2,) or not np.isfinite(self.origin).all():
            raise LayoutError(f"the origin must be two finite numbers [m], got {self.origin}")


def space_of_occupancy(grid: Occupancy, places: Sequence[Room], *, cell: float = CELL) -> FreeSpace:
    """Free space of `grid`; room k is what lies in `places[k]`, room n what lies in none of the n.

    Of overlapping places the smaller one has the cell; heights are not looked at, a grid is of one
    storey. Cells are the grid's own, put together to at least `cell` metres, larger where the
    building is very large. One is floor when nothing in it is occupied and at least half of it is
    free, so that a wall stays a wall however thin it is. Floor that is cut off from the rest and
    smaller than a square metre is left out. Raises LayoutError where there is no floor.
    """
    free, occupied, origin = _cropped(grid)
    most = max(cell, float(np.sqrt(free.size * grid.resolution**2 / _MAX_CELLS)))
    factor = max(1, int(np.ceil(most / grid.resolution - 1e-6)))
    floor = ~_blocks(occupied, factor).any(axis=(1, 3))
    floor &= _blocks(free, factor).mean(axis=(1, 3)) >= 0.5
    side = factor * grid.resolution
    floor = _without_islands(_without_pinches(floor), _ISLAND / side**2)
    return FreeSpace(origin, side, _rooms(floor, places, origin, side))


def _cropped(
    grid: Occupancy,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
    """The part of a grid around what is free, and its corner [m]."""
    if not grid.free.any():
        raise LayoutError("the grid has no free cell; is it negated, or in another mode?")
    window, low = [], []
    for axis in (0, 1):
        at = np.flatnonzero(grid.free.any(axis=1 - axis))
        window.append(slice(max(int(at[0]) - 1, 0), int(at[-1]) + 2))
        low.append(window[-1].start)
    corner = grid.origin + np.array(low) * grid.resolution
    return grid.free[tuple(window)], grid.occupied[tuple(window)], corner


def _blocks(cells: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """(nx, factor, ny, factor) blocks of cells, filled up with False."""
    nx, ny = (-(-n // factor) for n in cells.shape)
    full = np.zeros((nx * factor, ny * factor), np.bool_)
    full[: cells.shape[0], : cells.shape[1]] = cells
    return full.reshape(nx, factor, ny, factor)


def _without_pinches(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`floor` without cells that touch others across a corner of walls, where one cannot walk.

    Sight runs along diagonals, so a slanted wall would leak there.
    """
    tight = floor.copy()
    a, b, c, d = tight[:-1, :-1], tight[1:, 1:], tight[1:, :-1], tight[:-1, 1:]
    pairs = ((a, b, c, d), (c, d, a, b))
    while True:
        pinched = False
        for first, second, one, other in pairs:
            at = first & second & ~one & ~other
            first &= ~at
            pinched |= bool(at.any())
        if not pinched:  # what was taken away may have left others
            return tight


def _without_islands(floor: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """`floor` without parts of less than `least` cells; the largest part always stays."""
    number = connected_components(floor)
    sizes = np.bincount(number[floor], minlength=1)
    large = sizes >= min(least, sizes.max())
    return np.asarray(floor & large[number], np.bool_)


def _rooms(
    floor: NDArray[np.bool_], places: Sequence[Room], origin: NDArray[np.float64], cell: float
) -> NDArray[np.int32]:
    """(nx, ny) which of `places` each floor cell lies in, their count for none."""
    rooms = np.where(floor, len(places), NO_ROOM).astype(np.int32)
    x, y = (low + (np.arange(n) + 0.5) * cell for low, n in zip(origin, floor.shape, strict=True))
    for number in sorted(range(len(places)), key=lambda k: (-places[k].area, k)):
        place = places[number]
        rooms[floor & place.contains_each(x[:, None], y[None, :])] = number
    return rooms
