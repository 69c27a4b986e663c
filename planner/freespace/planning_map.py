"""Planning map: the places of a map, and the free space of its floor as far as it was seen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.occupancy import tile_iri
from kg.maps.query.evaluation import Value
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Area
from kg.model.errors import LayoutError
from kg.model.place_names import place_titles
from kg.model.records import UNKNOWN
from kg.rdf.literals import area_of_polygon
from mapping.occupancy.mapped_floor import MappedFloor
from planner.freespace.floor_plan import BEHIND, Frontier, free_space, seen_space, with_frontiers
from planner.freespace.grid import CELL, NO_ROOM, FreeSpace
from planner.settings import BeliefSettings

_MIN_SIDE: float = 0.3  # [m] side of a rectangle that is floor
_MAX_CELLS: float = 4e5  # of a grid; larger buildings get larger cells
_MAX_CELL: float = 1.0  # [m] larger cells show no doors
_MAX_MARGIN_ROOMS: int = 40
_NEAR = 0.5  # [m] from a room within which a spot needs no margin of its own
_MARGIN: float = BEHIND + 0.2  # [m] of grid around what was seen


@dataclass(frozen=True, slots=True, eq=False)
class UnexploredArea:
    """Floor that is assumed beyond a frontier."""

    iri: str  # of the part of a floor tile that the frontier lies in
    label: str
    p_map: NDArray[np.float64]  # (2,) [m] middle of the frontier
    width: float  # [m] of the frontier


@dataclass(frozen=True, slots=True, eq=False)
class PlanningMap:
    """Free space, and which place each of its rooms is."""

    space: FreeSpace
    rooms: tuple[str, ...]  # place IRI by number of room; "" where a room is no place
    names: tuple[str, ...]  # label of each room
    seen: NDArray[np.bool_] | None = None  # (nx, ny) cells that depth showed; None: not known
    unexplored: tuple[UnexploredArea, ...] = ()

    def room_at(self, p_map: NDArray[np.float64], place: str | None = None) -> int:
        """The room of a position, which is that of its place where it has one."""
        if place and place in self.rooms:
            return self.rooms.index(place)
        return int(self.space.room.reshape(-1)[self.space.nearest(p_map)])

    def seen_share(self, place: str) -> float:
        """Share of a place that was seen, 0..1; 1 where it is unknown, or all wall."""
        if self.seen is None or place not in self.rooms:
            return 1.0
        inside = self.space.inside(self.rooms.index(place))
        return float(self.seen.reshape(-1)[inside].mean()) if len(inside) else 1.0


def planning_map_of(
    places: Sequence[Place],
    spots: Iterable[NDArray[np.float64]],
    settings: BeliefSettings,
    floor: MappedFloor | None = None,
    base: str = "",
) -> PlanningMap | None:
    """The floor of `places`, and around each of `spots` (2,) [m] that lies in no place.

    The observed `floor` takes precedence, and floor is assumed beyond its frontiers. `base` is the
    IRI of the map. Returns None where there is no floor at all.
    """
    with_area = [p for p in places if min(p.size) >= _MIN_SIDE]
    margins = _margin_rooms(with_area, spots, settings.outside)
    parts = [*with_area, *margins]
    if not parts:
        return None
    cell = _cell(parts)
    if floor is not None:
        with_floor = _cell([*parts, Area(*floor.bounds.T.reshape(-1).tolist())])
        if with_floor > max(cell, _MAX_CELL):
            floor = None  # the observed floor lies far from all places
        else:
            cell = with_floor
    space = free_space(parts, cell=cell)
    iris = (*(p.iri for p in with_area), *("" for _ in margins))
    names = (*(p.name for p in with_area), *("open floor" for _ in margins))
    if floor is None:
        return PlanningMap(space, iris, names)
    return _as_seen(PlanningMap(space, iris, names), parts, floor, base)


def _as_seen(
    assumed: PlanningMap, rooms: Sequence[Area], floor: MappedFloor, base: str
) -> PlanningMap:
    try:
        known = seen_space(assumed.space, rooms, floor, margin=_MARGIN)
    except LayoutError:
        return assumed  # no traversable cell was observed
    seen, frontiers = with_frontiers(known)
    beyond = _unexplored(frontiers, floor, base)
    return PlanningMap(
        replace(seen.space, unseen=seen.states == UNKNOWN),
        (*assumed.rooms, "", *(one.iri for one in beyond)),
        (*assumed.names, "open floor", *(one.label for one in beyond)),
        seen.states != UNKNOWN,
        beyond,
    )


def _unexplored(
    frontiers: Iterable[Frontier], floor: MappedFloor, base: str
) -> tuple[UnexploredArea, ...]:
    found = list[UnexploredArea]()
    for frontier in frontiers:
        tile = tile_iri(base, floor.storey, *floor.tile_at(frontier.p_map))
        number = sum(one.iri.startswith(f"{tile}#") for one in found) + 1
        x, y = (float(c) for c in frontier.p_map)
        label = f"unexplored floor beyond ({x:.1f}, {y:.1f})"
        iri = f"{tile}#frontier-{number}"
        found.append(UnexploredArea(iri, label, frontier.p_map, frontier.width))
    return tuple(found)


def planning_map_on(space: FreeSpace, places: Sequence[Place]) -> PlanningMap:
    """Planning map on a given floor; each room is the place that contains most of it."""
    count = int(space.room.max()) + 1
    iris, names = [""] * count, [f"room {room}" for room in range(count)]
    for room in np.unique(space.room[space.room != NO_ROOM]):
        xy = space.centres(space.floor(int(room)))
        shares = [float(place.contains_each(*xy.T).mean()) for place in places]
        best = int(np.argmax(shares)) if shares else -1
        if best >= 0 and shares[best] > 0.5 and places[best].iri not in iris:
            iris[int(room)], names[int(room)] = places[best].iri, places[best].name
    return PlanningMap(space, tuple(iris), tuple(names))


def _margin_rooms(
    rooms: Sequence[Area], spots: Iterable[NDArray[np.float64]], reach: float
) -> list[Area]:
    margins: list[Area] = []
    for x, y in spots:
        if len(margins) < _MAX_MARGIN_ROOMS and not any(_near(r, x, y) for r in (*rooms, *margins)):
            margins.append(Area(x - reach, x + reach, y - reach, y + reach))
    return margins


def _near(room: Area, x: float, y: float) -> bool:
    across = room.xmin - _NEAR <= x <= room.xmax + _NEAR
    return across and room.ymin - _NEAR <= y <= room.ymax + _NEAR


def _cell(rooms: Sequence[Area]) -> float:
    width = max(r.xmax for r in rooms) - min(r.xmin for r in rooms)
    depth = max(r.ymax for r in rooms) - min(r.ymin for r in rooms)
    return max(CELL, float(np.sqrt(width * depth / _MAX_CELLS)))


Row = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Place(Area):
    """Place of a map: an area of its floor, and the kinds of room that it may be."""

    iri: str
    label: str
    views: int = 0
    beliefs: dict[str, float] = field(default_factory=dict)  # category IRI -> belief
    names: dict[str, str] = field(default_factory=dict)  # category IRI -> label
    last_seen: float | None = None  # [s] when something in it was last seen
    name: str = ""  # what tells it from the others: ``kitchen``, ``place 4``


def all_places(semantic_map: SemanticMap, sightings: Iterable[Row] = ()) -> tuple[Place, ...]:
    """Every place of the map with its beliefs; `sightings` are rows of `goals-last-seen`."""
    last_seen = {
        str(row["place"]): time.timestamp()
        for row in sightings
        if (time := time_or_none(row, "lastSeen")) is not None
    }
    found: dict[str, Place] = {}
    for row in semantic_map.query("goals-rooms").records():
        iri = str(row["iri"])
        if iri not in found:
            found[iri] = _without_beliefs(row, last_seen.get(iri))
        if row["kind"] is not None:
            found[iri].beliefs[str(row["kind"])] = number(row, "belief")
            found[iri].names[str(row["kind"])] = str(row["category"])
    names = {kind: label for place in found.values() for kind, label in place.names.items()}
    named = [(iri, place.label, place.beliefs) for iri, place in found.items()]
    titles = place_titles(named, names.__getitem__)
    return tuple(
        replace(place, name=title) for place, title in zip(found.values(), titles, strict=True)
    )


def _without_beliefs(row: Row, last_seen: float | None) -> Place:
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


def text_or_none(row: Row, column: str) -> str | None:
    """A text or IRI of a row; None where the column is unbound."""
    return None if row[column] is None else str(row[column])


def time_or_none(row: Row, column: str) -> datetime | None:
    """A time of a row; None where the column is unbound or holds something else."""
    value = row[column]
    return value if isinstance(value, datetime) else None
