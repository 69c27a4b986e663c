"""Areas of the map's horizontal plane: rectangles, polygons, and the bounds of turned boxes.

An outline is a ring of corners (x, y) [m], and further rings for holes. A ring does not repeat its
first corner at its end. shapely, which computes the polygons, is imported on first use. Oriented
boxes stand upright and are turned by a yaw about the vertical.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, groupby
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import shapely

Ring = tuple[tuple[float, float], ...]
Outline = tuple[Ring, ...]  # () means: the bounding rectangle itself

MAX_CORNERS: Final = 2000  # of an outline
MAX_COORDINATE: Final = 1e6  # [m] from the origin
_MIN_PIECE: Final = 0.05  # [m^2] of a part of an area
_MIN_AREA: Final = 1e-12  # [m^2]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Axis-aligned rectangle of the map's horizontal plane [m]; its sides belong to it.

    The constructor does not validate. Readers of external data do (`kg.maps.facts`,
    `mapping.places.layout`).
    """

    xmin: float
    xmax: float
    ymin: float
    ymax: float

    @property
    def size(self) -> tuple[float, float]:
        """Width along x and depth along y [m]."""
        return self.xmax - self.xmin, self.ymax - self.ymin

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return (self.xmax - self.xmin) * (self.ymax - self.ymin)

    @property
    def centre(self) -> tuple[float, float]:
        """Midpoint (x, y) [m]."""
        return (self.xmin + self.xmax) / 2, (self.ymin + self.ymax) / 2

    def contains(self, x: float, y: float) -> bool:
        """Point-in-rectangle test of (x, y) [m]."""
        return self.xmin <= x <= self.xmax and self.ymin <= y <= self.ymax

    def contains_each(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Point-in-rectangle test of many points, `x` and `y` [m] of one shape or broadcast."""
        inside = (x >= self.xmin) & (x <= self.xmax) & (y >= self.ymin) & (y <= self.ymax)
        return np.asarray(inside)

    def union(self, other: Rectangle) -> Rectangle:
        """Bounding rectangle of both."""
        return Rectangle(
            min(self.xmin, other.xmin),
            max(self.xmax, other.xmax),
            min(self.ymin, other.ymin),
            max(self.ymax, other.ymax),
        )


@dataclass(frozen=True, slots=True)
class Area(Rectangle):
    """A polygon with its bounding rectangle; without an `outline`, the rectangle itself."""

    outline: Outline = field(default=(), kw_only=True)

    @property
    def polygon(self) -> shapely.Polygon:
        """The shapely polygon of the area, prepared for tests of many points."""
        return polygon_of(self.rings)

    @property
    def area(self) -> float:
        """Area [m^2] without holes."""
        return float(self.polygon.area) if self.outline else Rectangle.area.__get__(self)

    @property
    def centre(self) -> tuple[float, float]:
        """Centroid (x, y) [m]; another inner point where the centroid is outside."""
        if not self.outline:
            return Rectangle.centre.__get__(self)  # type: ignore[no-any-return]
        point = self.polygon.centroid
        if not self.polygon.intersects(point):
            point = self.polygon.representative_point()
        return float(point.x), float(point.y)

    @property
    def rings(self) -> Outline:
        """The outline; for a rectangle, a ring of its four corners."""
        return self.outline or (
            (
                (self.xmin, self.ymin),
                (self.xmax, self.ymin),
                (self.xmax, self.ymax),
                (self.xmin, self.ymax),
            ),
        )

    @property
    def oriented_rings(self) -> Outline:
        """The rings: the outer one anticlockwise, holes clockwise."""
        return tuple(
            ring if (_signed_area(ring) > 0) == (number == 0) else ring[::-1]
            for number, ring in enumerate(self.rings)
        )

    def contains(self, x: float, y: float) -> bool:
        """Point-in-polygon test of (x, y) [m]; the boundary belongs to the area."""
        return bool(self.contains_each(np.array([x]), np.array([y]))[0])

    def contains_each(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Point-in-polygon test of many points, `x` and `y` [m] of one shape or broadcast."""
        inside = Rectangle.contains_each(self, x, y)
        if self.outline and inside.any():
            import shapely

            x, y = np.broadcast_arrays(x, y)
            inside[inside] = shapely.intersects_xy(self.polygon, x[inside], y[inside])
        return inside

    def shared_area(self, other: Area) -> float:
        """Area [m^2] of the intersection with `other`."""
        return float(self.polygon.intersection(other.polygon).area)

    def without(self, others: Sequence[Area]) -> Area | None:
        """The largest piece outside of `others`, to the centimetre; None if little is left."""
        import shapely

        rest = self.polygon.difference(shapely.union_all([other.polygon for other in others]))
        pieces = [part for part in shapely.get_parts(rest) if part.geom_type == "Polygon"]
        largest = max(pieces, key=lambda piece: piece.area, default=None)
        return None if largest is None or largest.area < _MIN_PIECE else rounded_area(largest)

    def shifted(self, dx: float) -> Self:
        """The area moved by `dx` [m] along x."""
        moved = tuple(tuple((x + dx, y) for x, y in ring) for ring in self.outline)
        return replace(self, xmin=self.xmin + dx, xmax=self.xmax + dx, outline=moved)


def area_of(outline: Sequence[Sequence[tuple[float, float]]]) -> Area:
    """The area with that outline [m]: the outer ring, then the rings of holes.

    The last corner of a ring may repeat the first. An axis-aligned rectangle is recognised.

    Raises:
        ValueError: the outline does not enclose one area; the message names the fault.
    """
    rings = tuple(_open(ring) for ring in outline)
    problem = _problem(rings)
    if problem:
        raise ValueError(problem)
    corners = np.array(rings[0])
    (xmin, ymin), (xmax, ymax) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    box = {(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)}
    rectangular = len(rings) == 1 and len(rings[0]) == 4 and set(rings[0]) == box
    return Area(xmin, xmax, ymin, ymax, outline=() if rectangular else rings)


def rounded_area(polygon: shapely.Polygon) -> Area:
    """The area of a polygon, its corners rounded to the centimetre."""
    simple = polygon.simplify(0.005)
    rings = (simple.exterior, *simple.interiors)
    return area_of([[(round(x, 2), round(y, 2)) for x, y in ring.coords] for ring in rings])


def _open(ring: Sequence[tuple[float, float]]) -> Ring:
    """`ring` without repeated neighbours, the first and the last corner included."""
    corners = [corner for corner, _ in groupby((float(x), float(y)) for x, y in ring)]
    return tuple(corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners)


def _problem(rings: Outline) -> str | None:
    """The fault of an outline, and a remedy; None for a valid outline."""
    if not rings:
        return "the outline has no ring; one ring of (x, y) in metres would work"
    count = sum(len(ring) for ring in rings)
    if count > MAX_CORNERS:
        return f"the outline has {count} corners; up to {MAX_CORNERS} would work"
    if not np.isfinite([*chain.from_iterable(rings)]).all():
        return "a corner of the outline is not finite; metres in the map frame would work"
    corners = chain.from_iterable(chain.from_iterable(rings))
    if max(map(abs, corners), default=0.0) > MAX_COORDINATE:
        return f"a corner lies beyond {MAX_COORDINATE:g} m; metres in the map frame would work"
    for ring in rings:
        if len(ring) < 3 or abs(_signed_area(ring)) < _MIN_AREA:
            return "the outline encloses no area; three or more corners around the place would work"
    import shapely

    reason = shapely.is_valid_reason(shapely.Polygon(rings[0], rings[1:]))
    # rings may touch in points
    if not reason.startswith(("Valid Geometry", "Ring Self-intersection")):
        return "the outline crosses itself; corners in order around the place would work"
    return None


def _signed_area(ring: Ring) -> float:
    """Area of a ring by the shoelace formula [m^2]; positive for an anticlockwise ring."""
    x, y = np.array(ring).T
    x, y = x - x[0], y - y[0]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


@lru_cache(maxsize=256)
def polygon_of(rings: Outline) -> shapely.Polygon:
    """Prepared polygon with these rings [m]; a ring that touches itself gives several parts."""
    import shapely

    polygon = shapely.make_valid(shapely.Polygon(rings[0], rings[1:]))
    shapely.prepare(polygon)
    return polygon


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
