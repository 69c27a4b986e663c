"""Oriented boxes: upright boxes turned by a yaw about the vertical, as corners and bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


def footprint(centre: Floats, extent: Floats, yaw: float) -> Floats:
    """(4, 2) [m] corners from above, counterclockwise, of a box with that `centre` (2 or more,).

    `extent` (2 or more,) [m] are its sides, `yaw` [rad] turns it counterclockwise.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    corners: Floats = centre[:2] + _CORNERS * extent[:2] @ np.array([(c, s), (-s, c)])
    return corners


def upright_bounds(extent: Floats, yaw: Floats | float) -> Floats:
    """(..., 3) [m] sides of the boxes along the map's axes that hold turned ones."""
    c, s = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    x, y, z = np.moveaxis(extent, -1, 0)
    return np.stack(np.broadcast_arrays(c * x + s * y, s * x + c * y, z), axis=-1)


def along(vectors: Floats, yaw: Floats | float) -> Floats:
    """Components (..., 3) of vectors (..., 3) along axes turned by `yaw` [rad] about z."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def along_nearest_axes(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """Sides [m] and yaw [rad] of the same footprint with a yaw of at most 45 degrees."""
    quarters = round(yaw / (math.pi / 2))
    return (*((y, x) if quarters % 2 else (x, y)), yaw - quarters * math.pi / 2)


@dataclass(frozen=True, slots=True, eq=False)
class OrientedBox:
    """An upright box, turned by `yaw` [rad] about the vertical through its `centre`."""

    centre: Floats  # (3,) [m]
    extent: Floats  # (3,) [m] sides along its own axes
    yaw: float

    def overlap(self, other: OrientedBox) -> float:
        """Volume that both have, as a share of the volume that either has (IoU), exact."""
        import shapely  # takes 20 ms

        plans = [
            shapely.Polygon(footprint(box.centre, box.extent, box.yaw)) for box in (self, other)
        ]
        tops = [box.centre[2] + box.extent[2] / 2 for box in (self, other)]
        bottoms = [box.centre[2] - box.extent[2] / 2 for box in (self, other)]
        height = max(min(tops) - max(bottoms), 0.0)
        shared = float(plans[0].intersection(plans[1]).area * height)
        both = float(self.extent.prod() + other.extent.prod()) - shared
        return shared / both if both > 0 else 0.0
