"""Frontiers: where seen floor ends at what nobody has seen, and floor assumed behind them.

After Yamauchi, "A frontier-based approach for autonomous exploration" (CIRA 1997): free cells next
to unknown ones, put together; what is narrower than a robot is none. Only floor outside of all
known places counts: inside of them it is assumed anyway.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.records import FREE, UNKNOWN
from mapping.occupancy.connected_components import connected_components
from planner.freespace.grid import NO_ROOM, Cells
from planner.freespace.seen_space import SeenSpace

BEHIND: Final = 2.6  # [m] of floor assumed beyond a frontier
NARROW: Final = 0.6  # [m] of frontier that a robot does not fit through
SMALL: Final = 2.0  # [m^2] less floor than this behind it is no room
MOST: Final = 20  # frontiers, the widest ones

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Frontier:
    """An edge of what was seen."""

    p_map: NDArray[np.float64]  # (2,) [m] the seen cell in the middle of the edge
    width: float  # [m] of the edge
    behind: Cells  # (n,) cells assumed to be floor beyond it


def with_frontiers(seen: SeenSpace) -> tuple[SeenSpace, tuple[Frontier, ...]]:
    """The floor with that beyond its frontiers, each a room of its own, after the rooms it has.

    Frontier k is room `seen.rooms + 1 + k`: the one before holds what is in no place.
    """
    space, cell = seen.space, seen.space.cell
    unknown = (seen.states == UNKNOWN) & ~seen.within & (space.room == NO_ROOM)
    edge = space.free & (seen.states == FREE) & _beside(unknown)
    region = _reached(_beside(edge) & unknown, unknown, round(BEHIND / cell))
    number = connected_components(region)
    touching = _numbers_beside(number, edge)
    found = []
    for part in np.unique(touching[touching >= 0]):
        cells = np.flatnonzero(number == part)
        at = np.flatnonzero(touching == part)
        wide, large = len(at) * cell, len(cells) * cell**2
        if wide >= NARROW - 1e-9 and large >= SMALL:
            xy = space.centres(at)
            middle = xy[int(np.argmin(((xy - xy.mean(axis=0)) ** 2).sum(axis=1)))]
            found.append(Frontier(middle, wide, cells))
    found = sorted(found, key=lambda f: (-f.width, int(f.behind[0])))[:MOST]
    room = space.room.copy()
    for k, frontier in enumerate(found):
        room.reshape(-1)[frontier.behind] = seen.rooms + 1 + k
    return replace(seen, space=replace(space, room=room)), tuple(found)


def _beside(mask: Mask) -> Mask:
    """The four neighbours of the cells of `mask`."""
    found = np.zeros_like(mask)
    found[1:] |= mask[:-1]
    found[:-1] |= mask[1:]
    found[:, 1:] |= mask[:, :-1]
    found[:, :-1] |= mask[:, 1:]
    return found


def _reached(start: Mask, through: Mask, steps: int) -> Mask:
    """What of `through` is at most `steps` cells from `start`."""
    reached = start
    for _ in range(steps - 1):
        reached = reached | (_beside(reached) & through)
    return reached


def _numbers_beside(number: NDArray[np.int64], edge: Mask) -> NDArray[np.int64]:
    """(nx, ny) for each cell of `edge` the part beside it, -1 elsewhere."""
    around = np.pad(number, 1, constant_values=-1)
    sides = (around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:])
    return np.where(edge, np.max(sides, axis=0), -1)
