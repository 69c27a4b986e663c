"""The look to take next: the ratio rule with looks ahead.

A look's worth is probability gained a second; so that a far room is judged by all that it offers
and not by the first look in it, each room is followed greedily and rated by the best beginning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.viewing.looks import Looks
from planner.viewing.memory import Memory
from planner.viewing.sensor import angle_between


@dataclass(frozen=True, slots=True)
class Standing:
    """Where the robot is: a floor cell, its heading [rad], and the position it stands at."""

    cell: int
    heading: float = 0.0
    stand: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Room:
    """The looks from within one room, and the cells they show."""

    rows: NDArray[np.intp]  # (k,) numbers of looks
    cells: NDArray[np.intp]  # (m,) which of the belief's cells
    chance: NDArray[np.float32]  # (k, m)

    def lessened(self, looks: Looks, memory: Memory) -> NDArray[np.float32]:
        """(k, m) `chance` after all looks that were taken."""
        stand, chance = looks.stand[self.rows], self.chance
        for one in np.unique(stand):
            worth = memory.worn(int(one))
            if worth is not None:
                chance = chance.copy() if chance is self.chance else chance
                chance[stand == one] *= worth[self.cells]
        return chance


class Tourist:
    """Chooses looks in one building for one belief after another."""

    def __init__(self, looks: Looks, *, ahead: int = 3) -> None:
        self.looks = looks
        self._ahead = ahead
        rooms = looks.space.room.reshape(-1)[looks.stands][looks.stand]
        self._rooms = [_room(looks, np.flatnonzero(rooms == room)) for room in np.unique(rooms)]
        from_stands = looks.chance.reshape(len(looks.stands), -1, len(looks.cells)) > 0
        self._shown: NDArray[np.bool_] = np.asarray(from_stands.any(axis=1), np.bool_)  # (s, c)

    @property
    def seeable(self) -> NDArray[np.bool_]:
        """(c,) cells that some look shows."""
        return np.asarray(self._shown.any(axis=0), np.bool_)

    def seeable_from(self, at: Standing) -> NDArray[np.bool_]:
        """(c,) cells that some look shows to which there is a way."""
        there = np.isfinite(self.looks.metres_from(at.cell))
        return np.asarray(self._shown[there].any(axis=0), np.bool_)

    def reached(self, at: Standing) -> NDArray[np.bool_]:
        """(n,) the looks to which there is a way."""
        there = np.isfinite(self.looks.metres_from(at.cell))
        return np.asarray(there[self.looks.stand], np.bool_)

    def costs(self, at: Standing, among: NDArray[np.intp]) -> NDArray[np.float64]:
        """(k,) [s] to drive, turn and look, for each of the looks `among`."""
        looks = self.looks
        stand = looks.stand[among]
        if at.stand is None:
            metres = looks.metres_from(at.cell)[stand]
        else:
            metres = looks.metres[at.stand, stand]
        here = looks.space.centres([at.cell])[0]
        towards = looks.space.centres(looks.stands[stand]) - here
        moved = metres > looks.space.cell / 2
        heading = np.where(moved, np.arctan2(towards[:, 1], towards[:, 0]), at.heading)
        first, last = looks.starts(among)
        turn = np.minimum(angle_between(heading, first), angle_between(heading, last))
        turn = np.where(looks.extent[among] >= 2 * np.pi - 1e-9, 0.0, turn)
        motion = looks.motion
        return metres / motion.speed + turn / motion.turn_rate + looks.seconds[among]

    def after(self, at: Standing, look: int) -> Standing:
        """Where the robot is once `look` is over."""
        looks = self.looks
        stand = int(looks.stand[look])
        cell = int(looks.stands[stand])
        if looks.extent[look] >= 2 * np.pi - 1e-9:
            return Standing(cell, at.heading, stand)
        ends = np.array([float(end[0]) for end in looks.starts([look])])
        came = at.heading
        if cell != at.cell:
            dx, dy = looks.space.centres([cell])[0] - looks.space.centres([at.cell])[0]
            came = float(np.arctan2(dy, dx))
        near = int(np.argmin(angle_between(came, ends)))
        return Standing(cell, float(ends[1 - near]), stand)

    def best(
        self,
        at: Standing,
        weight: NDArray[np.float64],
        memory: Memory | None = None,
        gains: NDArray[np.float64] | None = None,
    ) -> int | None:
        """The look to take next, or None where no look can show anything.

        `weight` (c,) is the belief that is left, in any scale; `gains` (n,) what the looks find of
        it, where that is known, 0 for those that are not to be taken.
        """
        memory = memory or Memory(self.looks)
        if gains is None:
            gains = memory.gains(weight)
        costs = self.costs(at, np.arange(len(gains)))
        rate = gains / costs
        best = int(np.argmax(rate))
        rated = float(rate[best])
        if not rated > 0:
            return None
        for room in self._rooms:
            most = float(weight[room.cells].sum()) * self.looks.sensor.recall
            if most <= rated * float(costs[room.rows].min()):
                continue  # nothing in this room can be worth the way
            look = int(room.rows[np.argmax(rate[room.rows])])
            worth = self._follow(at, weight, room, look, memory)
            if worth > rated + 1e-15:
                best, rated = look, worth
        return best

    def _follow(
        self, at: Standing, weight: NDArray[np.float64], room: _Room, look: int, memory: Memory
    ) -> float:
        """The rate of the best prefix of a greedy walk through one room that begins with `look`."""
        left, seconds, gained, worth = weight[room.cells], 0.0, 0.0, 0.0
        # what was looked at from the same positions before is worth as little on the way as now
        chance = room.lessened(self.looks, memory)
        for step in range(self._ahead + 1):
            seconds += float(self.costs(at, np.array([look]))[0])
            seen = chance[np.searchsorted(room.rows, look)] * left
            gained += float(seen.sum())
            worth = max(worth, gained / seconds)
            if step == self._ahead:
                break
            left, at = left - seen, self.after(at, look)
            ratio = (chance @ left.astype(np.float32)) / self.costs(at, room.rows)
            look = int(room.rows[np.argmax(ratio)])
        return worth


def _room(looks: Looks, rows: NDArray[np.intp]) -> _Room:
    chance = looks.chance[rows]
    cells = np.flatnonzero((chance > 0).any(axis=0))
    return _Room(rows, cells, np.ascontiguousarray(chance[:, cells]))
