"""Well-known text of points and polygons (OGC Simple Features, part 1; GeoSPARQL's wktLiteral)."""

from __future__ import annotations

import re
from typing import Final

from kg.areas import Area, Outline, area_of

_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_CRS: Final = r"\s*(?:<[^<>\s]*>\s+)?"
_CORNER: Final = re.compile(rf"({_NUMBER})\s+({_NUMBER})")
_POINT: Final = re.compile(
    rf"{_CRS}POINT\s*(?:Z\s*)?\(\s*({_NUMBER})\s+({_NUMBER})(?:\s+{_NUMBER})?\s*\)\s*", re.I
)
_POLYGON: Final = re.compile(rf"{_CRS}POLYGON\s*\(((?:[^()]*\([^()]*\))+)\s*\)\s*", re.I)
_RING: Final = re.compile(r"\(([^()]*)\)")
_LONGEST: Final = 100_000  # characters


def polygon_text(outline: Outline, crs: str) -> str:
    """WKT of a polygon with those rings [m], in the reference system with IRI `crs`."""
    rings = (
        f"({', '.join(f'{x:.12g} {y:.12g}' for x, y in (*ring, ring[0]))})" for ring in outline
    )
    return f"<{crs}> POLYGON ({', '.join(rings)})"


def area_of_polygon(text: str) -> Area:
    """The area of a WKT polygon [m].

    Raises ValueError, saying what is wrong, where `text` is none.
    """
    match = _POLYGON.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None:
        raise ValueError("no POLYGON ((x y, x y, x y, x y)) in well-known text")
    rings = []
    for ring in _RING.findall(match[1]):
        corners = [_CORNER.fullmatch(corner.strip()) for corner in ring.split(",")]
        if None in corners:
            raise ValueError("a polygon with a corner that is no x y")
        rings.append([(float(c[1]), float(c[2])) for c in corners if c is not None])
    return area_of(rings)


def point_of(text: str) -> tuple[float, float] | None:
    """(x, y) [m] of a WKT point, or None."""
    match = _POINT.fullmatch(text) if len(text) <= _LONGEST else None
    return None if match is None else (float(match[1]), float(match[2]))
