"""Free space from an occupancy grid: a coarser grid with closed walls, and rooms by places."""

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
_MIN_RESOLUTION: Final = 0.01  # [m] hundreds of finer cells would make one cell
_MAX_RESOLUTION: Final = 10.0  # [m]
_ISLAND: Final = 1.0  # [m^2] of separate floor below which it counts as noise


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Occupancy grid of a mapping robot's range finder.

    Raises LayoutError where the parts do not fit.
    """

    free: NDArray[np.bool_]  # (nx, ny)
    occupied: NDArray[np.bool_]  # (nx, ny); a cell that is neither is unknown
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
    """Free space of `grid`; room k is the floor in `places[k]`, room n the floor in none of n.

    Where places overlap, cells belong to the smaller one. Heights are ignored, since a grid has one
    storey. Cells are blocks of the grid's cells, of at least `cell` metres and larger in a very
    large building. A block is floor if no cell in it is occupied and at least half of it is free,
    so that thin walls stay closed. Separate floor of less than a square metre is left out. Raises
    LayoutError where there is no floor.
    """
    free, occupied, origin = _cropped(grid)
    side = max(cell, float(np.sqrt(free.size * grid.resolution**2 / _MAX_CELLS)))
    factor = max(1, int(np.ceil(side / grid.resolution - 1e-6)))
    floor = ~_blocks(occupied, factor).any(axis=(1, 3))
    floor &= _blocks(free, factor).mean(axis=(1, 3)) >= 0.5
    side = factor * grid.resolution
    floor = _without_islands(_without_pinches(floor), _ISLAND / side**2)
    return FreeSpace(origin, side, _rooms(floor, places, origin, side))


def _cropped(
    grid: Occupancy,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
    """The part of a grid around its free cells, and its corner [m]."""
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
    """(nx, factor, ny, factor) blocks of cells, padded with False."""
    padded = np.pad(cells, [(0, -n % factor) for n in cells.shape])
    nx, ny = (n // factor for n in padded.shape)
    return padded.reshape(nx, factor, ny, factor)


def _without_pinches(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`floor` without cells that touch other floor only diagonally, between two walls.

    Lines of sight run along diagonals, so they would cross a slanted wall there.
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
        if not pinched:  # a removed cell may have left another pinch
            return tight


def _without_islands(floor: NDArray[np.bool_], min_cells: float) -> NDArray[np.bool_]:
    """`floor` without parts of less than `min_cells` cells; the largest part always stays."""
    number = connected_components(floor)
    sizes = np.bincount(number[floor], minlength=1)
    large = sizes >= min(min_cells, sizes.max())
    return np.asarray(floor & large[number], np.bool_)


def _rooms(
    floor: NDArray[np.bool_], places: Sequence[Room], origin: NDArray[np.float64], cell: float
) -> NDArray[np.int32]:
    """(nx, ny) number of each floor cell's place; len(places) where it is in none."""
    rooms = np.where(floor, len(places), NO_ROOM).astype(np.int32)
    x, y = (low + (np.arange(n) + 0.5) * cell for low, n in zip(origin, floor.shape, strict=True))
    for number in sorted(range(len(places)), key=lambda k: (-places[k].area, k)):
        place = places[number]
        rooms[floor & place.contains_each(x[:, None], y[None, :])] = number
    return rooms
