"""Edits of rooms as geometry: the areas of places after a split, a merge, a moved wall, a drawing.

An edit gives areas to places. Other places lose what the new areas cover, so that no floor belongs
to two places because of an edit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from kg.model.areas import Area, area_of, rounded_area
from kg.model.errors import InvalidFactError
from kg.model.records import PlaceRecord
from kg.model.room_edit import Point

if TYPE_CHECKING:
    import shapely

MAX_GAP: Final = 0.6  # [m] between two places that can become one: a thick wall
_MIN_PIECE: Final = 0.05  # [m^2] smaller pieces of a place are dropped
_EXTENSION: Final = 100.0  # [m] that a line is extended at both ends


@dataclass(frozen=True, slots=True)
class EditedAreas:
    """The result of an edit: areas by IRI (a new place has the IRI ""), and places that go."""

    areas: Mapping[str, Area]
    removed: tuple[str, ...] = ()


def split(place: PlaceRecord, line: Sequence[Point]) -> EditedAreas:
    """Divide a place along a line; the larger part stays the place, the other one is new."""
    large, small = sorted(_halves(place.area.polygon, line, place.label), key=_size, reverse=True)
    return EditedAreas({place.iri: rounded_area(large), "": rounded_area(small)})


def merge(places: Sequence[PlaceRecord]) -> EditedAreas:
    """Make places one; the first stays, with the area of all."""
    first, *others = places
    return EditedAreas(
        {first.iri: rounded_area(_joined(places))}, tuple(place.iri for place in others)
    )


def move_wall(one: PlaceRecord, other: PlaceRecord, line: Sequence[Point]) -> EditedAreas:
    """Divide the area of two places anew along a line; each gets the part that it mostly had."""
    label = f"{one.label} and {other.label}"
    first, second = _halves(_joined((one, other)), line, label)
    if _shared(first, one) + _shared(second, other) < _shared(first, other) + _shared(second, one):
        first, second = second, first
    return EditedAreas({one.iri: rounded_area(first), other.iri: rounded_area(second)})


def draw(corners: Sequence[Point]) -> EditedAreas:
    """A new place with these corners."""
    try:
        return EditedAreas({"": area_of([corners])})
    except ValueError as error:
        raise InvalidFactError(f"cannot draw a place: {error}") from error


def cut(place: PlaceRecord, taken: Iterable[Area]) -> Area:
    """The area of a place without what was `taken`: its largest piece.

    Raises InvalidFactError if nothing of it would be left.
    """
    rest = place.area.without(list(taken))
    if rest is None:
        raise InvalidFactError(
            f"nothing of {place.label} would be left; merge the places, or leave a part of it"
        )
    return rest


def distance(area: Area, point: Point) -> float:
    """Distance of a point from an area [m]; 0 inside."""
    import shapely

    return float(area.polygon.distance(shapely.Point(point)))


def _halves(
    polygon: shapely.Geometry, line: Sequence[Point], label: str
) -> tuple[shapely.Polygon, shapely.Polygon]:
    """The two parts of a polygon on both sides of a line, which is extended at its ends."""
    import shapely
    from shapely.ops import split as split_by

    if len(line) < 2 or math.dist(line[0], line[-1]) < 0.01:
        raise InvalidFactError("a line needs two points that are apart, as in 1.5,0 1.5,4")
    given = shapely.LineString(line)
    inside = shapely.LineString(_extended(line)).intersection(polygon)
    pieces = [piece for piece in shapely.get_parts(inside) if piece.length > 0]
    if pieces:
        piece = max(pieces, key=lambda p: (p.buffer(0.01).intersection(given).length, p.length))
        ends = shapely.LineString(_extended(list(piece.coords), 0.01))
        parts = [part for part in split_by(polygon, ends).geoms if part.area >= _MIN_PIECE]
        if len(parts) == 2:
            return parts[0], parts[1]
    raise InvalidFactError(
        f"the line does not divide {label} in two; a line from wall to wall through it would work"
    )


def _extended(line: Sequence[Point], by: float = _EXTENSION) -> list[Point]:
    """The line with its first and its last point moved outward by `by` [m]."""

    def outward(end: Point, inner: Point) -> Point:
        share = by / math.dist(end, inner)
        return end[0] + (end[0] - inner[0]) * share, end[1] + (end[1] - inner[1]) * share

    return [outward(line[0], line[1]), *line[1:-1], outward(line[-1], line[-2])]


def _joined(places: Sequence[PlaceRecord]) -> shapely.Polygon:
    """The area of places that touch, or that a wall separates, with that wall."""
    import shapely

    whole = shapely.union_all([place.area.polygon for place in places])
    if whole.geom_type == "Polygon":
        return whole
    grown = whole.buffer(MAX_GAP / 2 + 0.01, join_style="mitre")
    closed = shapely.union(grown.buffer(-MAX_GAP / 2 - 0.01, join_style="mitre"), whole)
    if closed.geom_type != "Polygon":
        labels = " and ".join(place.label for place in places)
        raise InvalidFactError(
            f"{labels} do not touch; places at most {MAX_GAP:g} m apart would work"
        )
    return closed


def _shared(part: shapely.Polygon, place: PlaceRecord) -> float:
    return float(part.intersection(place.area.polygon).area)


def _size(polygon: shapely.Polygon) -> float:
    return float(polygon.area)
