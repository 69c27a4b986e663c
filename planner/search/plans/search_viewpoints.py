"""Viewpoints of a search: rooms worth covering, and positions from which things were seen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import Cells, FreeSpace
from planner.freespace.planning_map import PlanningMap
from planner.search.belief import TargetBelief
from planner.search.viewpoints.candidate_views import CandidateViews, Sensor
from planner.search.viewpoints.covering_viewpoints import COVERS, covering_viewpoints
from planner.settings import LOOK_AROUND, MAX_FLOOR, MAX_ROOMS, SPEED

_PROVEN = 3  # viewpoints of one thing from which it was seen, ...
_ALL_PROVEN = 24  # ... and of all things
_CLOSE = 0.6  # [m] from a camera within which the robot sees the same
_MOST = 0.1  # share of the heaviest cell's weight from which on a cell counts as shown


def proven_views(
    poses: Mapping[str, NDArray[np.float64]], space: FreeSpace, belief: TargetBelief
) -> Cells:
    """(m, 2) a floor cell, and a cell that a camera showed from there: that of a known thing.

    `poses` are of cameras that showed each thing, (n, 3, 4) by IRI.
    A floor plan knows no heights: things on shelves, or behind low walls, seem hidden there.
    """
    known = [p for p in belief.parts if p.candidate.kind == "known" and p.weight.max() > 0]
    known.sort(key=lambda part: (-part.candidate.probability, part.candidate.iri))
    known = known[:_ALL_PROVEN]
    floor = space.floor()
    centres, chosen = space.centres(floor), set[int]()
    pairs = list[tuple[int, int]]()
    for part in known:
        cells, own = belief.cells[part.weight >= _MOST * part.weight.max()], list[int]()
        for x, y in poses.get(part.candidate.iri, np.zeros((0, 3, 4)))[::-1, :2, 3]:
            off = np.hypot(*(centres - (x, y)).T)
            cell = int(floor[np.argmin(off)])
            if off.min() > _CLOSE or cell in own or len(own) == _PROVEN:
                continue
            if cell in chosen or len(chosen) < _ALL_PROVEN:
                own.append(cell)
        chosen.update(own)
        pairs += [(cell, int(shown)) for cell in own for shown in cells]
    return np.array(pairs, np.intp).reshape(-1, 2)


def with_fresh_viewpoints(
    planning_map: PlanningMap, views: CandidateViews, weight: NDArray[np.float64]
) -> CandidateViews:
    """`views` and further ones from fresh viewpoints, for cells of `weight` (c,)."""
    known = views.viewpoints
    fresh = search_viewpoints(
        planning_map, views.cells, weight, views.sensor, covers=2, besides=known
    )
    return views.with_viewpoints(planning_map.space, np.union1d(known, fresh))


Floats = NDArray[np.floating]

_A_LOOK: Final = 30.0  # [m2] of floor that a whole turn shows, about


def search_viewpoints(
    planning_map: PlanningMap,
    cells: Cells,
    weight: NDArray[np.float64],
    sensor: Sensor,
    start: ArrayLike | None = None,
    *,
    covers: int = COVERS,
    besides: ArrayLike = (),
) -> Cells:
    """Viewpoints that cover every cell `covers` times, without those in `besides`.

    In a building of more than MAX_ROOMS rooms, or MAX_FLOOR floor, only some rooms get viewpoints:
    those with most of `weight` (c,) for the time that it takes to drive there from `start` (2,) [m]
    and to look around, and as many with free floor: a room full of tables is seen from others.
    Of one room that is larger than MAX_FLOOR the part around the most probable cell gets them.
    """
    space = planning_map.space
    inside = space.inside()
    room_of = space.room.reshape(-1)
    if len(planning_map.rooms) > MAX_ROOMS or len(inside) * space.cell**2 > MAX_FLOOR:
        rooms = len(planning_map.rooms)
        size = np.bincount(room_of[inside], minlength=rooms) * space.cell**2
        mass = np.bincount(room_of[cells], weight, minlength=rooms)
        ranked = np.argsort(-mass / _seconds(space, size, start), kind="stable")
        with_floor = ranked[np.isin(ranked, space.room[space.free])]
        best = np.union1d(_first(ranked, size), _first(with_floor, size))
        kept = _around(space, inside[np.isin(room_of[inside], best)], int(cells[weight.argmax()]))
        space = space.without(np.setdiff1d(inside, kept))
    return covering_viewpoints(space, sensor.far, near=sensor.near, covers=covers, besides=besides)


def _around(space: FreeSpace, cells: Cells, middle: int) -> Cells:
    """Those of `cells` that are nearest to a cell, at most MAX_FLOOR of them."""
    off = np.hypot(*(space.centres(cells) - space.centres(middle)).T)
    return cells[np.argsort(off, kind="stable")[: int(MAX_FLOOR / space.cell**2)]]


def _seconds(space: FreeSpace, size: Floats, start: ArrayLike | None) -> Floats:
    """(r,) [s] to drive to each room of `size` (r,) [m2], and to look around in it."""
    looks = np.maximum(size / _A_LOOK, 1.0) * LOOK_AROUND
    if start is None:
        return np.asarray(looks)
    metres = distance_fields(space, [space.nearest(start)])[0][space.free]
    least = np.full(len(size), np.inf)
    np.minimum.at(least, space.room[space.free], metres)
    least[~np.isfinite(least)] = least[np.isfinite(least)].max(initial=0.0)
    return np.asarray(least / SPEED + looks)


def _first(ranked: NDArray[np.intp], size: Floats) -> NDArray[np.intp]:
    """The first rooms up to MAX_ROOMS and MAX_FLOOR; at least one."""
    many = int(np.searchsorted(np.cumsum(size[ranked]), MAX_FLOOR, side="right"))
    return ranked[: min(max(many, 1), MAX_ROOMS)]
