"""SPARQL functions that the engine does not have: math:sqrt and geof:sfWithin."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.model import vocabulary as v
from kg.model.areas import Area
from kg.rdf.literals import area_of_polygon, point_of
from kg.rdf.quad_store import Functions


def square_root(term: object) -> Literal | None:
    """XPath's math:sqrt; unbound for a term without a square root."""
    try:
        return Literal(math.sqrt(float(getattr(term, "value", ""))))
    except ValueError:
        return None


def within(point: object, polygon: object) -> Literal | None:
    """GeoSPARQL's geof:sfWithin for a point and a polygon in WKT; unbound for other terms."""
    spot = point_of(str(getattr(point, "value", "")))
    area = _area(str(getattr(polygon, "value", "")))
    return None if spot is None or area is None else Literal(area.contains(*spot))


@lru_cache(maxsize=1024)
def _area(text: str) -> Area | None:
    try:
        return area_of_polygon(text)
    except ValueError:
        return None


def load_libraries() -> None:
    """Import what the functions need; for processes that can load no library later."""
    square_root(Literal(2.0))
    within(Literal("POINT (1 1)"), Literal("POLYGON ((0 0, 4 0, 0 4, 0 0))"))


FUNCTIONS: Final[Functions] = {
    NamedNode(v.MATH_SQRT): square_root,
    NamedNode(v.GEOF_SF_WITHIN): within,
}
