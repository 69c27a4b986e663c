"""Well-known text of points and polygons (OGC Simple Features, part 1; GeoSPARQL's wktLiteral)."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final, Literal

from kg.model.areas import Area, Outline, area_of

if TYPE_CHECKING:
    import shapely

_CRS: Final = re.compile(r"\s*(?:<[^<>\s]*>\s+)?(?=POINT|POLYGON)", re.I)
_MAX_LENGTH: Final = 100_000  # characters


def polygon_text(outline: Outline, crs: str | None = None) -> str:
    """WKT of a polygon with the rings `outline` [m]; `crs` is the IRI of a reference system."""
    rings = (
        f"({', '.join(f'{x:.12g} {y:.12g}' for x, y in (*ring, ring[0]))})" for ring in outline
    )
    polygon = f"POLYGON ({', '.join(rings)})"
    return polygon if crs is None else f"<{crs}> {polygon}"


def area_of_polygon(text: str) -> Area:
    """The area of a WKT polygon [m]; raises ValueError, which names the fault."""
    polygon = _geometry(text, "Polygon")
    if polygon is None:
        raise ValueError("no POLYGON ((x y, x y, x y, x y)) in well-known text")
    rings = polygon.exterior, *polygon.interiors
    return area_of([[(x, y) for x, y, *_ in ring.coords] for ring in rings])


def point_of(text: str) -> tuple[float, float] | None:
    """(x, y) [m] of a WKT point, or None."""
    point = _geometry(text, "Point")
    if point is None or point.is_empty or not math.isfinite(point.x + point.y):
        return None
    return float(point.x), float(point.y)


def _geometry(text: str, kind: Literal["Point", "Polygon"]) -> shapely.Geometry | None:
    """The geometry of a WKT literal; None if it is invalid or of another kind."""
    crs = _CRS.match(text) if len(text) <= _MAX_LENGTH else None
    if crs is None:
        return None
    import shapely  # takes 20 ms; maps of rectangles do not need it

    try:
        geometry = shapely.from_wkt(text[crs.end() :], on_invalid="fix")
    except shapely.errors.ShapelyError:
        return None
    return geometry if geometry is not None and geometry.geom_type == kind else None
