"""Storeys of a building: heights of their floors, and the storey of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from mapping.occupancy.depth_projection import Floats, FramePoints
from mapping.occupancy.occupancy_settings import OccupancySettings

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
