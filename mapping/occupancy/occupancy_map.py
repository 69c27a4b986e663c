"""Occupancy map of the floor: log-odds in memory, classified tiles in the graph.

The graph can rebuild this cache without its log-odds, since a written tile holds only the class of
each cell.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from kg.maps.cache_invalidation import ExternalChanges
from kg.maps.facts.occupancy import tile_iri, tile_of
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Area
from kg.model.records import UNKNOWN, FloorTile, PlaceViews
from mapping.occupancy.depth_projection import Floats, floor_evidence, frame_points
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.storeys import Storeys
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
from mapping.occupancy.view_coverage import on_tile, view_coverage
from perception.frames import Frame

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

        def times(key: Key) -> ViewTimes | None:
            cached = self._tiles.get((storey, key))
            if cached is not None:
                return cached.tile.viewed
            known = self._known((storey, key))
            return None if known is None else _written(self._settings, known)[1]

        return view_coverage(area, times, self._settings, margin)

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
