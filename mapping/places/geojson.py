"""Polygons of places from GeoJSON (RFC 7946), in metres of the map frame.

RFC 7946 has longitude and latitude. Plans in metres use plain x and y and the "crs" member of the
format's predecessor; this module reads such plans. A document that names a geographic reference
system, or has a polygon so small that it must be in degrees, is an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from kg.model.areas import Area, area_of
from kg.model.errors import LayoutError

_GEOGRAPHIC: Final = ("CRS84", "4326", "WGS84", "WGS 84")
_MIN_AREA: Final = 0.01  # [m^2] of a place; a room in degrees has some 1e-9
_METRES: Final = "x and y in metres of the map frame would work"


def is_geojson(document: object) -> bool:
    """Whether a JSON document calls itself GeoJSON."""
    return isinstance(document, dict) and "type" in document


def polygons(document: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], Area]]:
    """Properties and area of each polygon, in order; an "id" of the feature is among them.

    Points are skipped: they are objects of exported maps, or labels of plans.

    Raises LayoutError, naming the feature, where one is no polygon, or is in degrees.
    """
    if any(name in str(document.get("crs", "")) for name in _GEOGRAPHIC):
        raise LayoutError(f"coordinates in degrees, by its crs; {_METRES}")
    return list(_features(document))


def _features(document: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], Area]]:
    features = document.get("features")
    if document["type"] != "FeatureCollection" or not isinstance(features, list):
        raise LayoutError(
            f"GeoJSON of type {document['type']!r}; a FeatureCollection of polygons would work"
        )
    for number, feature in enumerate(features, start=1):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise LayoutError(f"feature {number} is no Feature; one with a Polygon would work")
        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise LayoutError(f"feature {number} has properties that are no object; {{}} would do")
        geometry = feature.get("geometry")
        if isinstance(geometry, dict) and geometry.get("type") == "Point":
            continue  # a mark or an object on the plan
        own = {"id": feature["id"]} if _is_number(feature.get("id")) else {}
        yield own | properties, _area(geometry, number)


def _area(geometry: object, number: int) -> Area:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind != "Polygon":
        raise LayoutError(
            f"feature {number} is a {kind or 'feature without a shape'}; a Polygon each would work"
        )
    try:
        area = area_of([list(map(_corner, ring)) for ring in geometry["coordinates"]])
    except (KeyError, TypeError):
        raise LayoutError(
            f"feature {number} has coordinates that are no rings of [x, y]; {_METRES}"
        ) from None
    except ValueError as error:
        raise LayoutError(f"feature {number} has {error}") from None
    if area.area < _MIN_AREA:
        raise LayoutError(
            f"feature {number} is smaller than 0.1 m by 0.1 m, as if in degrees; {_METRES}"
        )
    return area


def _corner(position: object) -> tuple[float, float]:
    """x and y [m] of a position; a third number, the height, is left out."""
    if not isinstance(position, list) or len(position) < 2 or not all(map(_is_number, position)):
        raise TypeError
    try:
        return float(position[0]), float(position[1])
    except OverflowError:
        raise TypeError from None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
