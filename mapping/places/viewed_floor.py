"""Viewed floor: how much of each place was viewed, by frames or by a robot without depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import FloorTile, MapUpdate, PlaceRecord
from mapping.occupancy.mapped_floor import FloorView
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.room_segmentation import SegmentationSettings
from mapping.places.place_registry import PlaceRegistry


class ViewedFloor:
    """Floor that a robot's camera had in view, and the places on it; writes nothing.

    Views of floor that no depth image has shown do not count.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._settings = OccupancySettings()
        self._occupancy = OccupancyMap(semantic_map, self._settings)
        self._places = PlaceRegistry(semantic_map, recording=None)

    def add(self, views: Sequence[FloorView], height: float, stamp: float) -> None:
        """Add the floor in view of a robot at height `height` [m] at `stamp` [s]."""
        points = [self._points(view) for view in views if len(view.p_map)]
        if points:
            p_map, close = (np.concatenate(part) for part in zip(*points, strict=True))
            self._occupancy.refresh()
            self._occupancy.add_views(p_map, close, height, stamp)

    def _points(self, view: FloorView) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Points of the remembered views' grid, and whether each is viewed from close by."""
        s = self._settings
        parts = max(int(np.ceil(view.cell / (s.cell * s.view) - 1e-6)), 1)  # of a cell's side
        steps = ((np.arange(parts) + 0.5) / parts - 0.5) * view.cell
        offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        p_map = (view.p_map[:, None, :] + offsets).reshape(-1, 2)
        return p_map, np.repeat(view.metres <= s.close, parts**2)

    def take_changed(self, stamp: float) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        """Tiles that have changed enough, to be written at `stamp` [s], and their places."""
        return self._with_places(self._occupancy.take_changed(stamp))

    def take_rest(self) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        """Tiles that have changed at all, and their places."""
        return self._with_places(self._occupancy.take_rest())

    def _with_places(
        self, floor: tuple[FloorTile, ...]
    ) -> tuple[tuple[FloorTile, ...], tuple[PlaceRecord, ...]]:
        if not floor:
            return (), ()
        self._places.refresh()
        update_place_views(self._places, self._occupancy, floor)
        return floor, self._places.take_changed()

    def undo(self, update: MapUpdate) -> None:
        """Mark tiles and places of `update` as changed again, which could not be written."""
        self._occupancy.undo(update.floor)
        self._places.undo(update.places)


_WALLS: Final = SegmentationSettings().walls  # [m] that outlines of found rooms reach into walls


def update_place_views(
    places: PlaceRegistry, occupancy: OccupancyMap, floor: Sequence[FloorTile]
) -> None:
    """Update the viewed shares of the places in which the changed tiles, `floor`, lie."""
    if not floor:
        return
    for place in places.places():
        storey = occupancy.touches(place.area, floor)
        walls = _WALLS if place.from_floor else 0.0
        viewed = None if storey is None else occupancy.views(place.area, storey, walls)
        if viewed is not None and viewed != place.viewed:
            places.put(replace(place, viewed=viewed))
