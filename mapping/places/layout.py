"""Place layout: the areas of places, read from a file (thesis section 3.3.2, Fig. 3.11).

JSON is a list of {"xmin", "xmax", "ymin", "ymax"} [m] with optional "id" (the place's number),
"label" (or "name") and "category"; the lists the thesis author's robot saved have this shape too
(their beliefs are not read here). CSV has the same names as columns. GeoJSON polygons are read by
`mapping.places.geojson`. Places may overlap: the one listed first holds a point that lies in
several.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from kg.maps.map_extent import MAX_SIDE
from kg.model.areas import MAX_COORDINATE, Rectangle
from kg.model.errors import LayoutError
from kg.model.regular_files import read_text
from mapping.places.geojson import is_geojson, polygons

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
        if is_geojson(entries):
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
