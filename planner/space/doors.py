"""Doors: the openings between rooms, shut or perhaps shut.

A door that is known to be shut stops robot and eye. One that may be shut costs the detour that is
then expected, so that a way through it is chosen only where it saves more than that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.errors import LayoutError
from planner.space.grid import NO_ROOM, Cells, FreeSpace

DETOUR: Final = 10.0  # [m] expected of a way found shut: there, back, and around


@dataclass(frozen=True, slots=True, eq=False)
class Door:
    """One opening between two rooms."""

    rooms: tuple[int, int]  # numbers, the smaller first
    cells: Cells  # (n,) all that touch the other room, on the side where they are fewer; ascending
    p_map: NDArray[np.float64]  # (2,) [m] its middle


def doors(space: FreeSpace) -> tuple[Door, ...]:
    """The openings through which one walks from room to room, by numbers of rooms, then by place.

    Two rooms may have several. Passages (stairs) are none.
    """
    found = []
    for pair, sill in _sills(space).items():
        for part in _parts(sill, space.shape[1]):
            at = np.array(sorted(part), np.intp)
            first, second = (at[space.room.reshape(-1)[at] == room] for room in pair)
            cells = first if len(first) <= len(second) else second
            found.append(Door(pair, cells, space.centres(cells).mean(axis=0)))
    return tuple(sorted(found, key=lambda door: (door.rooms, int(door.cells[0]))))


def _sills(space: FreeSpace) -> dict[tuple[int, int], set[int]]:
    """For each two rooms that touch, the cells of both that touch the other's, by number.

    Cells that touch at a corner only count where one can step around it.
    """
    ny = space.shape[1]
    found: dict[tuple[int, int], set[int]] = {}
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        for x, y in _borders(np.where(space.free, space.room, NO_ROOM), dx, dy).tolist():
            if not (space.free[x + dx, y] or space.free[x, y + dy]):
                continue
            near, far = int(space.room[x, y]), int(space.room[x + dx, y + dy])
            sill = found.setdefault((min(near, far), max(near, far)), set())
            sill.update((x * ny + y, (x + dx) * ny + y + dy))
    return found


def _borders(room: NDArray[np.int32], dx: int, dy: int) -> NDArray[np.intp]:
    """(n, 2) cells whose neighbour at (dx, dy) belongs to another room; dx is 0 or 1."""
    nx, ny = room.shape
    before, after = max(0, -dy), max(0, dy)
    a, b = room[: nx - dx, before : ny - after], room[dx:, after : ny - before]
    found = np.argwhere((a != b) & (a != NO_ROOM) & (b != NO_ROOM))
    found[:, 1] += before
    return found


def _parts(cells: set[int], columns: int) -> Iterator[list[int]]:
    """The connected parts of a set of cells, corners included."""
    left = set(cells)
    while left:
        part = [left.pop()]
        for cell in part:
            sides = [j for j in (-1, 0, 1) if 0 <= cell % columns + j < columns]
            near = {cell + i * columns + j for i in (-1, 0, 1) for j in sides} & left
            left -= near
            part.extend(sorted(near))
        yield part


def shut(space: FreeSpace, found: Iterable[Door]) -> FreeSpace:
    """The same floor with these doors shut; raises LayoutError where no floor would be left."""
    cells = [door.cells for door in found]
    return space.without(np.concatenate(cells)) if cells else space


def door_toll(
    space: FreeSpace, likely: Mapping[Door, float], detour: float = DETOUR
) -> NDArray[np.float64]:
    """(nx, ny) [m] for `distance_fields`: the detour expected at doors that may be shut.

    `likely` gives the probability of each. Raises LayoutError for what is no probability.
    """
    toll = np.zeros(space.shape, np.float64)
    for door, probability in likely.items():
        if not 0 <= probability <= 1:
            raise LayoutError(
                f"the probability that a door is shut must lie in 0..1, got {probability}"
            )
        toll.reshape(-1)[door.cells] += probability * detour
    return toll
