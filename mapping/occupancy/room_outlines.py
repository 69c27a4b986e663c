"""Outlines of the rooms of a grid: the union of their cells, simplified (Douglas, Peucker 1973)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area, area_of
from perception.binary_masks import connected_components, runs

_MIN_HOLE: Final = 0.5  # [m^2] smaller ones are part of the room
_STEP: Final = 0.01  # [m] to which corners are rounded


def room_areas(
    rooms: NDArray[np.int32],
    origin: NDArray[np.float64],
    cell: float,
    *,
    reach: float,
    noise: float,
) -> tuple[Area, ...]:
    """The area [m] of each of `rooms` (nx, ny), numbered from 0, -1 for none.

    Rooms reach up to `reach` [m] beyond their cells, or to the next room, into walls and the
    furniture along them. Outlines deviate by up to `noise` [m] from the cells.
    """
    steps = round(reach / cell)
    grown = np.pad(rooms, steps, constant_values=-1)
    for _ in range(steps):
        grown = _grown(grown)
    corner = origin - steps * cell
    return tuple(_area(grown == k, corner, cell, noise) for k in range(int(rooms.max()) + 1))


def _grown(rooms: NDArray[np.int32]) -> NDArray[np.int32]:
    """Each cell of no room given to the room of a neighbour, the lowest number of several."""
    none = np.iinfo(np.int32).max
    beside = np.pad(np.where(rooms < 0, none, rooms), 1, constant_values=none)
    for axis in (0, 1):  # over squares of three by three, so that corners stay corners
        along = np.moveaxis(beside, axis, 0)
        along = np.minimum.reduce([along[:-2], along[1:-1], along[2:]])
        beside = np.moveaxis(along, 0, axis)
    return np.where((rooms < 0) & (beside != none), beside, rooms).astype(np.int32)


def _area(mask: NDArray[np.bool_], corner: NDArray[np.float64], cell: float, noise: float) -> Area:
    """The largest part of `mask` (nx, ny), whose corner is at `corner` (2,) [m]."""
    import shapely

    parts = connected_components(mask)
    largest = parts == np.argmax(np.bincount(parts[mask]))
    x, a, b = runs(largest).T
    whole = shapely.union_all(shapely.box(x, a, x + 1, b))
    holes = [r for r in whole.interiors if shapely.Polygon(r).area * cell**2 >= _MIN_HOLE]
    # a ring keeps its first corner: the normal form begins with an extreme one
    whole = shapely.Polygon(whole.exterior, holes).normalize().simplify(noise / cell)
    rounded = shapely.set_precision(shapely.transform(whole, lambda at: corner + at * cell), _STEP)
    outline = max(shapely.get_parts(rounded), key=lambda part: part.area)
    return area_of([ring.coords for ring in (outline.exterior, *outline.interiors)])
