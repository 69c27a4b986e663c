"""The floor of a map: its places as free space, and some floor around what is in no place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.finding.candidates import Place
from planner.finding.settings import Belief
from planner.space.building import free_space
from planner.space.grid import CELL, NO_ROOM, FreeSpace, Room

_LEAST: float = 0.3  # [m] side of a rectangle that is floor
_MOST_CELLS: float = 4e5  # of a grid; larger buildings get larger cells
_MOST_YARDS: int = 40


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Free space, and which place each of its rooms is."""

    space: FreeSpace
    rooms: tuple[str, ...]  # place IRI by number of room; "" where a room is no place
    names: tuple[str, ...]  # what people call each room

    def room_at(self, p_map: NDArray[np.float64], place: str | None = None) -> int:
        """The room of a position, which is that of its place where it has one."""
        if place and place in self.rooms:
            return self.rooms.index(place)
        return int(self.space.room.reshape(-1)[self.space.nearest(p_map)])


def ground_of(
    places: Sequence[Place], spots: Iterable[NDArray[np.float64]], settings: Belief
) -> Ground | None:
    """The floor of `places` and around those `spots` (2,) [m] that are in none of them.

    None where neither has any area.
    """
    with_area = [p for p in places if min(p.xmax - p.xmin, p.ymax - p.ymin) >= _LEAST]
    rooms = [Room(p.xmin, p.xmax, p.ymin, p.ymax) for p in with_area]
    yards = _yards(rooms, spots, settings.outside)
    if not rooms and not yards:
        return None
    floor = [*rooms, *yards]
    space = free_space(floor, cell=_cell(floor))
    iris = (*(p.iri for p in with_area), *("" for _ in yards))
    return Ground(space, iris, (*(p.label for p in with_area), *("open floor" for _ in yards)))


def ground_on(space: FreeSpace, places: Sequence[Place]) -> Ground:
    """A floor that is given: each of its rooms is the place in whose rectangle most of it lies."""
    count = int(space.room.max()) + 1
    iris, names = [""] * count, [f"room {room}" for room in range(count)]
    for room in np.unique(space.room[space.room != NO_ROOM]):
        xy = space.centres(space.floor(int(room)))
        shares = [float(_inside(place, xy).mean()) for place in places]
        best = int(np.argmax(shares)) if shares else -1
        if best >= 0 and shares[best] > 0.5 and places[best].iri not in iris:
            iris[int(room)], names[int(room)] = places[best].iri, places[best].label
    return Ground(space, tuple(iris), tuple(names))


def _inside(place: Place, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    x, y = xy[:, 0], xy[:, 1]
    return (x >= place.xmin) & (x <= place.xmax) & (y >= place.ymin) & (y <= place.ymax)


def _yards(rooms: Sequence[Room], spots: Iterable[NDArray[np.float64]], reach: float) -> list[Room]:
    yards: list[Room] = []
    for x, y in spots:
        if len(yards) < _MOST_YARDS and not any(_near(r, x, y) for r in (*rooms, *yards)):
            yards.append(Room(x - reach, x + reach, y - reach, y + reach))
    return yards


def _near(room: Room, x: float, y: float, margin: float = 0.5) -> bool:
    across = room.xmin - margin <= x <= room.xmax + margin
    return across and room.ymin - margin <= y <= room.ymax + margin


def _cell(rooms: Sequence[Room]) -> float:
    width = max(r.xmax for r in rooms) - min(r.xmin for r in rooms)
    depth = max(r.ymax for r in rooms) - min(r.ymin for r in rooms)
    return max(CELL, float(np.sqrt(width * depth / _MOST_CELLS)))
