"""Place views: how much of each place was viewed, kept up with the view times of floor tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from kg.records import FloorTile
from mapping.occupancy.occupancy_map import OccupancyMap
from mapping.occupancy.room_segmentation import SegmentationSettings
from mapping.places.place_registry import PlaceRegistry

_WALLS: Final = SegmentationSettings().walls  # [m] that outlines of found rooms reach into walls


def update_place_views(
    places: PlaceRegistry, occupancy: OccupancyMap, floor: Sequence[FloorTile]
) -> None:
    """Update how much was viewed of the places that changed tiles, `floor`, lie in."""
    if not floor:
        return
    for place in places.places():
        storey = occupancy.touches(place.area, floor)
        walls = _WALLS if place.from_floor else 0.0
        viewed = None if storey is None else occupancy.views(place.area, storey, walls)
        if viewed is not None and viewed != place.viewed:
            places.put(replace(place, viewed=viewed))
