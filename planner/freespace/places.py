"""Places of a map for search planning, from the rows of `queries/goals-rooms.rq`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from kg.areas import Area
from kg.maps.semantic_map import SemanticMap
from kg.query.query_files import Value
from kg.rdf.wkt import area_of_polygon

Row = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Place(Area):
    """Place of a map: an area of its floor, and what kind of room it may be."""

    iri: str
    label: str
    views: int = 0
    beliefs: dict[str, float] = field(default_factory=dict)  # category IRI -> belief
    names: dict[str, str] = field(default_factory=dict)  # category IRI -> label
    last_seen: float | None = None  # [s] when something in it was last seen


def all_places(semantic_map: SemanticMap) -> tuple[Place, ...]:
    """Every place of the map with its beliefs."""
    seen = {
        str(row["place"]): row["lastSeen"].timestamp()
        for row in semantic_map.query("goals-last-seen").records()
        if isinstance(row["lastSeen"], datetime)
    }
    found: dict[str, Place] = {}
    for row in semantic_map.query("goals-rooms").records():
        iri = str(row["iri"])
        if iri not in found:
            found[iri] = _empty(row, seen.get(iri))
        if row["kind"] is not None:
            found[iri].beliefs[str(row["kind"])] = number(row, "belief")
            found[iri].names[str(row["kind"])] = str(row["category"])
    return tuple(found.values())


def _empty(row: Row, last_seen: float | None) -> Place:
    area = _area(row)
    return Place(
        iri=str(row["iri"]),
        label=str(row["label"] or row["iri"]),
        xmin=area.xmin,
        xmax=area.xmax,
        ymin=area.ymin,
        ymax=area.ymax,
        outline=area.outline,
        views=int(number(row, "views")),
        last_seen=last_seen,
    )


def _area(row: Row) -> Area:
    try:
        return area_of_polygon(str(row["outline"] or ""))
    except ValueError:  # a rectangle
        return Area(*(number(row, side) for side in ("xmin", "xmax", "ymin", "ymax")))


def number(row: Row, column: str) -> float:
    """A number of a row; TypeError where the graph holds none there."""
    value = row[column]
    if not isinstance(value, int | float):
        raise TypeError(f"column {column} must be a number, got {value!r}")
    return float(value)
