"""The floor of a map as the mapper keeps it: evidence in memory, what it comes to in the graph.

A cache that the graph can rebuild, but for how sure it is: of a tile that was written before, only
what each cell was believed to be is known.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from kg.floor import tile_iri
from kg.others import OthersWrites
from kg.records import UNKNOWN, FloorTile
from kg.semantic_map import SemanticMap
from mapping.floor.settings import FloorSettings
from mapping.floor.storeys import Storeys
from mapping.floor.sweep import Sweep, points_of, sweep
from mapping.floor.tiles import Key, States, Tile, evidence
from perception.frame import Frame

_Place = tuple[int, Key]  # storey and tile


class _Page:
    """One tile: its evidence, and what the graph was last told."""

    __slots__ = ("seen", "tile", "told", "unread", "written")

    def __init__(self, settings: FloorSettings, known: FloorTile | None) -> None:
        shape = (settings.side, settings.side)
        self.told: States = np.full(shape, UNKNOWN, np.uint8) if known is None else known.cells
        self.tile = Tile(settings, None if known is None else known.cells)
        self.written = -np.inf  # [s] stamp of the frame that it was last told with
        self.seen = 0.0  # [s] stamp of the last frame that said anything of it
        self.unread = False  # whether one did since it was last compared with what was told


class FloorBook:
    """The tiles of a map's floor. Frames go in, tiles that have changed enough come out."""

    def __init__(self, semantic_map: SemanticMap, settings: FloorSettings | None = None) -> None:
        self._map, self._settings = semantic_map, settings or FloorSettings()
        self._watch = OthersWrites(semantic_map)
        self._pages: dict[_Place, _Page] = {}  # the ones touched last come last
        self._fresh: dict[_Place, None] = {}  # touched since they were last told
        heights = {tile.storey: tile.height for tile in semantic_map.floor()}
        self._storeys = Storeys(heights, self._settings)

    def refresh(self) -> None:
        """Forget what others changed since the last call; cheap where nothing was."""
        touched = self._watch.take()
        if not touched:
            return
        for place in [p for p in self._pages if self._iri(p) in touched]:
            del self._pages[place]
            self._fresh.pop(place, None)

    def _iri(self, place: _Place) -> str:
        storey, (column, row) = place
        return tile_iri(self._map.base, storey, column, row)

    def add(self, frame: Frame) -> None:
        """Take in what `frame` shows of the floor."""
        points = points_of(frame.depth, frame.K, frame.T_map_cam, self._settings)
        camera = frame.T_map_cam[:3, 3]
        storey = self._storeys.below(camera, points)
        if storey is None:
            return
        height = self._storeys.heights[storey]
        self._take_in(storey, sweep(points, camera, height, self._settings), frame.stamp)

    def _take_in(self, storey: int, seen: Sweep, stamp: float) -> None:
        for key, free, hit, tall in evidence(seen, self._settings):
            place = (storey, key)
            page = self._pages.pop(place, None)
            if page is None:
                page = _Page(self._settings, self._known(place))
            self._pages[place] = page
            page.tile.add(free, hit, tall, self._settings)
            page.seen, page.unread = stamp, True
            self._fresh[place] = None

    def _known(self, place: _Place) -> FloorTile | None:
        """The tile as the graph has it, where its cells are like ours."""
        s, tile = self._settings, self._map.floor_tile(self._iri(place))
        fits = tile is not None and tile.cells.shape == (s.side, s.side)
        return tile if fits and tile is not None and tile.resolution == s.cell else None

    def take_changed(self, stamp: float) -> tuple[FloorTile, ...]:
        """Tiles to be told to the graph with the frame of `stamp` [s].

        Those that have changed enough and were not told just before, and those that are to be
        forgotten here.
        """
        s = self._settings
        old = list(self._pages)[: max(len(self._pages) - s.kept, 0)]
        fresh = ((place, self._pages[place]) for place in self._fresh)
        due = [p for p, page in fresh if page.unread and abs(stamp - page.written) >= s.pause]
        found = self._told(due, s.enough) + self._told([p for p in old if p in self._fresh], 1)
        for place in old:
            del self._pages[place]
            self._fresh.pop(place, None)
        return found

    def take_rest(self) -> tuple[FloorTile, ...]:
        """All that the graph has not been told yet."""
        return self._told(list(self._fresh), 1)

    def take_back(self, tiles: Iterable[FloorTile]) -> None:
        """Have tiles count as not told, that could not be written."""
        for tile in tiles:
            place = (tile.storey, (tile.column, tile.row))
            page = self._pages.get(place)
            if page is None:  # it was to be forgotten here, once it was told
                page = self._pages[place] = _Page(self._settings, tile)
                page.seen = tile.changed
            known = self._known(place)
            page.told = np.full_like(tile.cells, UNKNOWN) if known is None else known.cells
            page.written, page.unread = -np.inf, True
            self._fresh[place] = None

    def _told(self, places: Iterable[_Place], least: int) -> tuple[FloorTile, ...]:
        s, found = self._settings, list[FloorTile]()
        for place in places:
            storey, (column, row) = place
            page = self._pages[place]
            page.unread = False
            states = page.tile.states(s)
            differs = int((states != page.told).sum())
            if differs < least:
                if not differs:
                    del self._fresh[place]
                continue
            height = self._storeys.heights[storey]
            tile = FloorTile(storey, column, row, height, s.cell, states, page.seen)
            page.told, page.written = states, page.seen
            del self._fresh[place]
            found.append(tile)
        return tuple(found)
