"""Route: the shortest way over the known floor, with the doors and places on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.records import DoorRecord
from planner.freespace.geodesic import UNSEEN, distance_fields, shortest_path
from planner.freespace.planning_map import Place, all_places, planning_map_of
from planner.search.goals.search_facts import read_floor
from planner.settings import BELIEF

BESIDE: Final = 1.0  # [m] from the middle of a door within which a way leads through it


@dataclass(frozen=True, slots=True)
class Crossing:
    """A spot where a way leads from one place into another."""

    places: tuple[Place, Place]
    x: float  # [m]
    y: float
    door: DoorRecord | None  # that the map has there


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The shortest way between two positions, from floor to floor."""

    metres: float  # infinite where no way is known
    end: NDArray[np.float64]  # (2,) [m] the floor nearest to the goal
    notes: tuple[str, ...]  # where an end is off the floor
    unseen: float  # [m] of the way over floor that no depth image showed
    crossings: tuple[Crossing, ...]  # in order


def route(semantic_map: SemanticMap, start: ArrayLike, goal: ArrayLike) -> Route | None:
    """The shortest way from `start` to `goal` (2,) [m]; None for a map without floor.

    Floor that nobody saw counts as free where the map's places have it. Raises
    QueryParameterError for an end that is too far from the floor to belong to the building.
    """
    ends = [np.asarray(p, np.float64)[:2] for p in (start, goal)]
    places = all_places(semantic_map)
    floor = read_floor(semantic_map, semantic_map.robot())
    known = planning_map_of(places, (), BELIEF, floor, semantic_map.base)
    if known is None:
        return None
    space = known.space
    found = (space.off_floor(p, what) for p, what in zip(ends, ("start", "goal"), strict=True))
    notes = tuple(filter(None, found))
    first, last = (space.nearest(p) for p in ends)
    end = space.centres([last])[0]
    field = distance_fields(space, [last])[0]
    metres = float(field.reshape(-1)[first])
    if not np.isfinite(metres):
        return Route(metres, end, notes, 0.0, ())
    cells = shortest_path(space, field, first)
    points = space.centres(cells)
    unseen = 0.0 if known.seen is None else 1.0 - float(known.seen.reshape(-1)[cells].mean())
    metres /= 1.0 + (UNSEEN - 1) * unseen
    areas = [place for place in places if place.area > 0]
    inside = [next((p for p in areas if p.contains(x, y)), None) for x, y in points.tolist()]
    crossings = _crossings(semantic_map.doors(), points, inside)
    return Route(metres, end, notes, unseen * metres, crossings)


def _crossings(
    doors: Sequence[DoorRecord], points: NDArray[np.float64], inside: Sequence[Place | None]
) -> tuple[Crossing, ...]:
    """Points at which the way over `points` (n, 2) [m] leaves a place for the next one."""
    found, steps = list[Crossing](), [(n, p) for n, p in enumerate(inside) if p is not None]
    for (n, one), (m, other) in pairwise(steps):
        if one is not other:
            x, y = (float(c) for c in points[(n + m) // 2])
            between = [d for d in doors if set(d.places) == {one.iri, other.iri}]
            door = min(between, key=lambda d: math.dist((d.x, d.y), (x, y)), default=None)
            if door is not None and math.dist((door.x, door.y), (x, y)) > BESIDE:
                door = None
            found.append(Crossing((one, other), x, y, door))
    return tuple(found)
