"""Occupancy map: log-odds of the floor in memory, by storey, and classified tiles in the graph.

The graph can rebuild this cache without its log-odds, since a written tile holds only the class of
each cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.occupancy import tile_iri, tile_of
from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import ExternalChanges
from kg.model.areas import Area
from kg.model.records import TALL, UNKNOWN, FloorTile, PlaceViews
from mapping.occupancy.depth_projection import Floats, FramePoints, floor_evidence, frame_points
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import (
    Key,
    OccupancyTile,
    States,
    TileEvidence,
    ViewTimes,
    no_views,
    tile_evidence,
    view_evidence,
    views_of_known,
)
from perception.binary_masks import with_neighbours
from perception.frames import Frame

_BIN: Final = 0.1  # [m]


class Storeys:
    """Storeys observed so far, by number; the first one is the map's own, at height 0.

    The height of each is that of its first estimate: a map's floor does not drift.
    """

    def __init__(self, heights: Mapping[int, float], settings: OccupancySettings) -> None:
        self.heights = dict(heights) or {0: 0.0}  # storey -> [m] in the map frame
        self._settings = settings

    def below(self, camera: Floats, points: FramePoints) -> int | None:
        """Storey that `camera` (3,) [m] is above; a new one where `points` show its floor.

        None where neither is the case: on stairs, say.
        """
        s, z = self._settings, float(camera[2])
        known = self.under(z, s.lowest_camera)
        if known is not None:
            return known
        height = self._level_below(z, points)
        if height is None or any(abs(height - h) < s.storey for h in self.heights.values()):
            return None
        number = max(self.heights) + 1
        self.heights[number] = round(height, 2)
        return number

    def under(self, z: float, lowest: float) -> int | None:
        """Storey, of those known, that `z` [m] lies at least `lowest` [m] above; None for none."""
        highest = self._settings.highest_camera
        near = {n: z - h for n, h in self.heights.items() if lowest <= z - h <= highest}
        return min(near, key=lambda n: (near[n], n)) if near else None

    def _level_below(self, z: float, points: FramePoints) -> float | None:
        """Height [m] of the largest level among the points below the camera; None without one."""
        s = self._settings
        heights = points.xyz[2][np.isfinite(points.depth)]
        below = heights[(heights < z - s.lowest_camera) & (heights > z - s.highest_camera)]
        if not len(below):
            return None
        edges = np.arange(below.min(), below.max() + 2 * _BIN, _BIN)
        counts, _ = np.histogram(below, edges)
        at = int(np.argmax(counts))
        if counts[at] < s.level_share * len(heights):
            return None
        return float(np.median(below[(below >= edges[at]) & (below <= edges[at + 1])]))


_HALF: Final = 0.499  # of a cell: sides of areas may lie on those of cells
_MAX_CELLS: Final = 4_000_000  # of an area: 160,000 m2; larger ones are skipped ...
_MAX_CORNER: Final = 10**9  # ... nor those with a corner this many cells from the origin


def on_tile(area: Area, tile: FloorTile, span: float) -> bool:
    """Whether an area's bounding rectangle has ground in common with a tile of side `span` [m]."""
    x, y = tile.column * span, tile.row * span
    return x < area.xmax and x + span > area.xmin and y < area.ymax and y + span > area.ymin


def view_coverage(
    area: Area,
    tiles: Callable[[Key], tuple[States, ViewTimes] | None],
    settings: OccupancySettings,
    margin: float = 0.0,
) -> PlaceViews | None:
    """Views of an area by those of its tiles; None where nothing of it was viewed.

    Shares are of the cells that lie inside completely, `margin` [m] from the border, since cells
    nearer to it are wall, or floor beyond the wall. Unviewed cells with a tall obstacle do not
    count, nor unobserved ones beside them: nothing else stands inside a wardrobe.
    """
    cell, larger = settings.cell * settings.view, settings.side // settings.view
    corners = _corners(area, cell)
    width, depth = (corners[1] - corners[0]).tolist()
    if width * depth > _MAX_CELLS or float(np.abs(corners).max()) > _MAX_CORNER:
        return None
    low, shape = _grid(corners)
    times = np.zeros((2, *shape), np.uint32)
    tall, unknown = np.zeros(shape, np.bool_), np.ones(shape, np.bool_)
    columns, rows = (
        range(int(np.floor(start / larger)), int(np.ceil((start + count) / larger)))
        for start, count in zip(low, shape, strict=True)
    )
    for key in product(columns, rows):
        found = tiles(key)
        if found is None:
            continue
        states = found[0].reshape(larger, settings.view, larger, settings.view)
        offset = np.array(key) * larger - low  # of the tile on the area's grid
        first, last = np.maximum(offset, 0), np.minimum(offset + larger, shape)
        part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        own = tuple(slice(a, b) for a, b in zip(first - offset, last - offset, strict=True))
        times[:, *part] = found[1][:, *own]
        tall[part] = (states == TALL).any(axis=(1, 3))[own]
        unknown[part] = (states == UNKNOWN).all(axis=(1, 3))[own]
    furniture = (tall | unknown & with_neighbours(tall)) & (times[1] == 0)
    inside = times[:, _cells_within(area, cell, margin) & ~furniture]
    if not inside.any():
        return None
    close, share = (round(float((grid > 0).mean()), 3) for grid in inside)
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


_TileKey = tuple[int, Key]  # storey and tile


class _CachedTile:
    """One tile: its log-odds, and its states as written to the graph."""

    __slots__ = ("compared", "observed", "tile", "viewed", "written", "written_at")

    def __init__(self, settings: OccupancySettings, known: FloorTile | None) -> None:
        self.written, self.viewed = _written(settings, known)
        self.tile = OccupancyTile(settings, None if known is None else known.cells, self.viewed)
        self.written_at = -np.inf  # [s] stamp of the frame that it was last written with
        self.observed = 0.0  # [s] stamp of the last frame with evidence of it
        self.compared = True  # whether it was compared with what is written since then


class OccupancyMap:
    """Occupancy map in tiles, from frames to tiles that have changed enough to be written."""

    def __init__(
        self, semantic_map: SemanticMap, settings: OccupancySettings | None = None
    ) -> None:
        self._map, self._settings = semantic_map, settings or OccupancySettings()
        self._watch = ExternalChanges(semantic_map)
        self._tiles: dict[_TileKey, _CachedTile] = {}  # least recently observed first
        self._unwritten: dict[_TileKey, None] = {}  # observed since they were last written
        heights = {tile.storey: tile.height for tile in semantic_map.floor()}
        self._storeys = Storeys(heights, self._settings)

    def refresh(self) -> None:
        """Drop tiles that others changed since the last call."""
        touched = self._watch.take()
        if not touched:
            return
        for key in [p for p in self._tiles if self._iri(p) in touched]:
            del self._tiles[key]
            self._unwritten.pop(key, None)

    def _iri(self, key: _TileKey) -> str:
        storey, (column, row) = key
        return tile_iri(self._map.base, storey, column, row)

    def add(self, frame: Frame) -> None:
        """Update the log-odds with the floor evidence of `frame`."""
        points = frame_points(frame.depth, frame.K, frame.T_map_cam, self._settings)
        camera = frame.T_map_cam[:3, 3]
        storey = self._storeys.below(camera, points)
        if storey is None:
            return
        height = self._storeys.heights[storey]
        observed = floor_evidence(points, camera, height, self._settings)
        for number, evidence in tile_evidence(observed, self._settings):
            self._add_to_tile((storey, number), evidence, frame.stamp)

    def add_views(
        self, p_map: Floats, close: NDArray[np.bool_], height: float, stamp: float
    ) -> None:
        """Update the times of views of floor that a camera without depth had in view.

        `p_map` (n, 2) [m] are points no further apart than the larger cells, `close` (n,) whether
        each was viewed from close by, `height` [m] the height of the camera or its robot. Only
        floor that depth has shown before counts, since occlusions elsewhere are unknown.
        """
        storey = self._storeys.under(height, -self._settings.lowest_camera)
        if storey is None:
            return
        for number, viewed in view_evidence(p_map, close, self._settings):
            key = (storey, number)
            states = self._states_of(key)
            if states is not None:
                self._add_to_tile(key, views_of_known(viewed, states, self._settings), stamp)

    def _states_of(self, key: _TileKey) -> States | None:
        """States of a tile, in memory or in the graph; None where there is none."""
        cached = self._tiles.get(key)
        if cached is not None:
            return cached.tile.states(self._settings)
        known = self._known(key)
        return None if known is None else known.cells

    def _add_to_tile(self, key: _TileKey, evidence: TileEvidence, stamp: float) -> None:
        cached = self._tiles.pop(key, None)
        if cached is None:
            cached = _CachedTile(self._settings, self._known(key))
        self._tiles[key] = cached
        cached.tile.add(evidence, stamp, self._settings)
        cached.observed, cached.compared = stamp, False
        self._unwritten[key] = None

    def _known(self, key: _TileKey) -> FloorTile | None:
        """Tile in the graph, if its cells have this size."""
        s, tile = self._settings, tile_of(self._map.engine, self._iri(key))
        fits = tile is not None and tile.cells.shape == (s.side, s.side)
        return tile if fits and tile is not None and tile.resolution == s.cell else None

    def take_changed(self, stamp: float) -> tuple[FloorTile, ...]:
        """Tiles to be written with the frame of `stamp` [s].

        These are tiles that have changed enough since they were last written, some time ago, and
        tiles that leave the cache.
        """
        s = self._settings
        old = list(self._tiles)[: max(len(self._tiles) - s.kept, 0)]
        unwritten = ((key, self._tiles[key]) for key in self._unwritten)
        due = [
            p
            for p, cached in unwritten
            if not cached.compared and abs(stamp - cached.written_at) >= s.pause
        ]
        found = self._states(due) + self._states(
            [p for p in old if p in self._unwritten], rest=True
        )
        for key in old:
            del self._tiles[key]
            self._unwritten.pop(key, None)
        return found

    def touches(self, area: Area, tiles: Iterable[FloorTile]) -> int | None:
        """The storey of a tile of `tiles` that an area's bounding rectangle touches, if any."""
        touching = (tile for tile in tiles if on_tile(area, tile, self._settings.span))
        return next((tile.storey for tile in touching), None)

    def views(self, area: Area, storey: int, margin: float = 0.0) -> PlaceViews | None:
        """Share of an area on a storey that was viewed, by tiles in memory or in the graph.

        Cells nearer than `margin` [m] to the area's border do not count.
        """

        def tile(key: Key) -> tuple[States, ViewTimes] | None:
            cached = self._tiles.get((storey, key))
            if cached is not None:
                return cached.tile.states(self._settings), cached.tile.viewed
            known = self._known((storey, key))
            return None if known is None else _written(self._settings, known)

        return view_coverage(area, tile, self._settings, margin)

    def take_rest(self) -> tuple[FloorTile, ...]:
        """Tiles with any state that is not written yet."""
        return self._states(list(self._unwritten), rest=True)

    def undo(self, tiles: Iterable[FloorTile]) -> None:
        """Mark tiles as unwritten again, that could not be written."""
        for tile in tiles:
            key = (tile.storey, (tile.column, tile.row))
            cached = self._tiles.get(key)
            if cached is None:  # it had left the cache
                cached = self._tiles[key] = _CachedTile(self._settings, tile)
                cached.observed = tile.changed
            cached.written, cached.viewed = _written(self._settings, self._known(key))
            cached.written_at, cached.compared = -np.inf, False
            self._unwritten[key] = None

    def _states(self, keys: Iterable[_TileKey], *, rest: bool = False) -> tuple[FloorTile, ...]:
        """Tiles that have changed enough; with `rest` all that have changed."""
        s, found = self._settings, list[FloorTile]()
        for key in keys:
            storey, (column, row) = key
            cached = self._tiles[key]
            cached.compared = True
            states = cached.tile.states(s)
            viewed = cached.tile.viewed
            differs = int((states != cached.written).sum())
            views = viewed != cached.viewed
            if not differs and not views.any():
                del self._unwritten[key]
                continue
            if not rest and differs < s.enough and not self._viewed_enough(cached, viewed):
                continue
            height = self._storeys.heights[storey]
            seen = viewed.copy()
            tile = FloorTile(storey, column, row, height, s.cell, states, cached.observed, seen)
            cached.written, cached.viewed, cached.written_at = states, seen, cached.observed
            del self._unwritten[key]
            found.append(tile)
        return tuple(found)

    def _viewed_enough(self, cached: _CachedTile, viewed: ViewTimes) -> bool:
        s, anew = self._settings, int((viewed > 0).sum() - (cached.viewed > 0).sum())
        before = cached.viewed > 0
        later = viewed[before].astype(np.int64) - cached.viewed[before]
        return anew >= s.enough_views or int(later.max(initial=0)) * 60 >= s.refresh


def _written(settings: OccupancySettings, known: FloorTile | None) -> tuple[States, ViewTimes]:
    """States and view times of a tile in the graph."""
    if known is None:
        return np.full((settings.side, settings.side), UNKNOWN, np.uint8), no_views(settings)
    fits = known.viewed is not None and known.viewed.shape == no_views(settings).shape
    return known.cells, known.viewed if fits and known.viewed is not None else no_views(settings)
