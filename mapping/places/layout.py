"""Place layout: areas of places, from a file (thesis section 3.3.2, Fig. 3.11) or GeoJSON.

JSON is a list of {"xmin", "xmax", "ymin", "ymax"} [m] with optional "id" (the place's number),
"label" (or "name") and "category"; the lists the thesis author's robot saved have this shape too
(their beliefs are not read here). CSV has the same names as columns. GeoJSON polygons are read by
`polygons`. Places may overlap: the one listed first holds a point that lies in
several.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from kg.maps.map_extent import MAX_SIDE
from kg.model.areas import MAX_COORDINATE, Area, Rectangle, area_of
from kg.model.errors import LayoutError
from kg.model.regular_files import read_text

_GEOGRAPHIC: Final = ("CRS84", "4326", "WGS84", "WGS 84")
_MIN_AREA: Final = 0.01  # [m^2] of a place; a room in degrees has some 1e-9
_METRES: Final = "x and y in metres of the map frame would work"


def polygons(document: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], Area]]:
    """Properties and area of each polygon, in order; an "id" of the feature is among them.

    Points are skipped: they are objects of exported maps, or labels of plans.

    Raises LayoutError, naming the feature, where one is no polygon, or is in degrees.
    """
    if any(name in str(document.get("crs", "")) for name in _GEOGRAPHIC):
        raise LayoutError(f"coordinates in degrees, by its crs; {_METRES}")
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


SIDES: Final = ("xmin", "xmax", "ymin", "ymax")


@dataclass(frozen=True, slots=True)
class LayoutPlace:
    """One place of a layout. Raises LayoutError where its area is empty or not finite."""

    number: int  # N of <base>place/N
    label: str
    area: Rectangle  # [m] map frame; a polygon where it is an `Area` with an outline
    category: str | None = None  # label of its category, where the file gives one

    def __post_init__(self) -> None:
        sides = {side: getattr(self.area, side) for side in SIDES}
        if not all(math.isfinite(value) for value in sides.values()):
            raise LayoutError(f"{self.label} has a side that is not finite; metres would work")
        if max(map(abs, sides.values())) > MAX_COORDINATE:
            raise LayoutError(
                f"{self.label} has a side beyond {MAX_COORDINATE:g} m; metres of the map would work"
            )
        for low, high in (("xmin", "xmax"), ("ymin", "ymax")):
            if not sides[low] < sides[high]:
                raise LayoutError(
                    f"{self.label} has {low} {sides[low]:g} and {high} {sides[high]:g}; "
                    f"{low} below {high} would work"
                )
            if (side := sides[high] - sides[low]) > MAX_SIDE:
                raise LayoutError(
                    f"{self.label} is {side:,.0f} m long: are these millimetres? metres of the map "
                    "would work"
                )


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of a building. Raises LayoutError where two share a number, or none are given."""

    places: tuple[LayoutPlace, ...]

    def __post_init__(self) -> None:
        if not self.places:
            raise LayoutError("a layout without places; at least one rectangle would work")
        numbers = [place.number for place in self.places]
        twice = {number for number in numbers if numbers.count(number) > 1}
        if twice:
            raise LayoutError(f"two places share the id {min(twice)}; one id each would work")


def load_layout(path: Path) -> Layout:
    """Read a layout from JSON or GeoJSON or, by the suffix .csv, from CSV.

    Raises LayoutError, naming the file and the entry, where it does not make sense.
    """
    try:
        text = read_text(path, "utf-8-sig")
        is_csv = path.suffix.lower() == ".csv"
        rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
        entries: Any = list(rows) if is_csv else json.loads(text)
    except (OSError, ValueError, RecursionError, csv.Error) as error:
        raise LayoutError(f"cannot read places from {path}: {error}") from error
    try:
        if isinstance(entries, dict) and "type" in entries:
            areas = enumerate(polygons(entries), start=1)
            return Layout(tuple(_place(properties, n, area) for n, (properties, area) in areas))
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise LayoutError(
                "no list of places; [{xmin, xmax, ymin, ymax}] or GeoJSON polygons would work"
            )
        return Layout(
            tuple(
                _place(entry, n, Rectangle(**{side: _side(entry, side, n) for side in SIDES}))
                for n, entry in enumerate(entries, start=1)
            )
        )
    except LayoutError as error:
        raise LayoutError(f"{path}: {error}") from error


def _place(entry: Mapping[str, Any], position: int, area: Rectangle) -> LayoutPlace:
    number = _number(entry, position)
    label = entry.get("label") or entry.get("name") or f"place {number}"
    category = entry.get("category") or None
    return LayoutPlace(
        number=number,
        label=str(label),
        area=area,
        category=None if category is None else str(category),
    )


def _number(entry: Mapping[str, Any], position: int) -> int:
    given = entry.get("id")
    if given is None or given == "":
        return position
    try:
        number = int(given)
    except (TypeError, ValueError, OverflowError):
        number = -1
    if number < 0 or (isinstance(given, float) and number != given):
        raise LayoutError(f"place {position} has the id {given!r}; a whole number would work")
    return number


def _side(entry: Mapping[str, Any], side: str, position: int) -> float:
    if side not in entry:
        raise LayoutError(f"place {position} has no {side}; all of {', '.join(SIDES)} would work")
    value = entry[side]
    try:
        if isinstance(value, bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise LayoutError(
            f"place {position} has {side} {value!r}; a number of metres would work"
        ) from None
