"""View coverage: share of an area that was viewed, by the view times of floor tiles."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area
from kg.model.records import FloorTile, PlaceViews
from mapping.occupancy.depth_projection import Floats
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import Key, ViewTimes

_HALF: Final = 0.499  # of a cell: sides of areas may lie on those of cells
_MAX_CELLS: Final = 4_000_000  # of an area: 160,000 m2; larger ones are skipped ...
_MAX_CORNER: Final = 10**9  # ... nor those with a corner this many cells from the origin


def on_tile(area: Area, tile: FloorTile, span: float) -> bool:
    """Whether an area's bounding rectangle has ground in common with a tile of side `span` [m]."""
    x, y = tile.column * span, tile.row * span
    return x < area.xmax and x + span > area.xmin and y < area.ymax and y + span > area.ymin


def view_coverage(
    area: Area,
    views: Callable[[Key], ViewTimes | None],
    settings: OccupancySettings,
    margin: float = 0.0,
) -> PlaceViews | None:
    """Views of an area by those of its tiles; None where nothing of it was viewed.

    Shares are of the cells that lie inside completely, `margin` [m] from the border, since cells
    nearer to it are wall, or floor beyond the wall.
    """
    cell, larger = settings.cell * settings.view, settings.side // settings.view
    corners = _corners(area, cell)
    width, depth = (corners[1] - corners[0]).tolist()
    if width * depth > _MAX_CELLS or float(np.abs(corners).max()) > _MAX_CORNER:
        return None
    low, shape = _grid(corners)
    times = np.zeros((2, *shape), np.uint32)
    columns, rows = (
        range(int(np.floor(start / larger)), int(np.ceil((start + count) / larger)))
        for start, count in zip(low, shape, strict=True)
    )
    for key in product(columns, rows):
        viewed = views(key)
        if viewed is None:
            continue
        offset = np.array(key) * larger - low  # of the tile on the area's grid
        first, last = np.maximum(offset, 0), np.minimum(offset + larger, shape)
        part = [slice(a, b) for a, b in zip(first, last, strict=True)]
        own = [slice(a, b) for a, b in zip(first - offset, last - offset, strict=True)]
        times[:, part[0], part[1]] = viewed[:, own[0], own[1]]
    inside = times[:, _cells_within(area, cell, margin)]
    if not inside.any():
        return None
    close, share = (round(float((grid > 0).mean()), 2) for grid in inside)
    return PlaceViews(max(close, share), close, float(inside.max()) * 60)


def _corners(area: Area, cell: float) -> Floats:
    """(2, 2) [cells] of an area's bounding rectangle."""
    return np.array([[area.xmin, area.ymin], [area.xmax, area.ymax]]) / cell


def _grid(corners: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First cell and shape (2,) of the cells of `corners` (2, 2) [cells]."""
    low = np.floor(corners[0]).astype(np.intp)
    return low, np.ceil(corners[1]).astype(np.intp) - low


@lru_cache(maxsize=32)
def _cells_within(area: Area, cell: float, margin: float) -> NDArray[np.bool_]:
    """(nx, ny) cells of an area's grid that lie inside it, `margin` [m] from its border."""
    low, shape = _grid(_corners(area, cell))
    x, y = (
        (start + np.arange(count) + 0.5) * cell for start, count in zip(low, shape, strict=True)
    )
    within = _within(area, x, y, max(margin, _HALF * cell))
    if margin and not within.any():
        within = _within(area, x, y, _HALF * cell)
    return within


def _within(area: Area, x: Floats, y: Floats, margin: float) -> NDArray[np.bool_]:
    """(nx, ny) points whose square of half side `margin` [m] has all corners in the area."""
    found = np.ones((len(x), len(y)), np.bool_)
    for dx, dy in product((-margin, margin), repeat=2):
        found &= area.contains_each(x[:, None] + dx, y[None, :] + dy)
    return found
