"""Grid cells: a spatial index of square cells for queries by distance.

Each object has the IRI of the cell that contains it. A query over a disc or a box first binds the
few cells that touch the area, then filters exactly. With a million objects that takes 1 ms; a
filter alone takes 400 ms.
"""

from __future__ import annotations

import math

from kg.model.vocabulary import CELL

SIDE = 5.0  # [m]
MAX_CELLS = 2500  # in a query; with more, a plain filter is as quick


def cell_of(x: float, y: float) -> str:
    """IRI of the cell that contains (x, y) [m]."""
    return f"{CELL}{math.floor(x / SIDE)}_{math.floor(y / SIDE)}"


def cells_of_box(xmin: float, xmax: float, ymin: float, ymax: float) -> tuple[str, ...] | None:
    """IRIs of all cells that touch the box [m]; None for more than `MAX_CELLS`."""
    if not all(math.isfinite(side) for side in (xmin, xmax, ymin, ymax)):
        return None
    west, east = math.floor(xmin / SIDE), math.floor(xmax / SIDE)
    south, north = math.floor(ymin / SIDE), math.floor(ymax / SIDE)
    if (east - west + 1) * (north - south + 1) > MAX_CELLS:
        return None
    columns, rows = range(west, east + 1), range(south, north + 1)
    return tuple(f"{CELL}{column}_{row}" for column in columns for row in rows)


def cells_of_disc(x: float, y: float, radius: float) -> tuple[str, ...] | None:
    """IRIs of all cells that touch the bounding box of the disc [m]; None for too many."""
    return cells_of_box(x - radius, x + radius, y - radius, y + radius)
