"""Our way of searching: belief on cells, the look worth most next, an update after each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.trials.building import Building
from planner.trials.hidden import Hidden
from planner.trials.robot import Outcome
from planner.viewing.belief import belief_from, room_weights
from planner.viewing.looks import picture
from planner.viewing.tour import Memory, Standing

#: Probability that it is there at all, before the search, and below which the search is given up.
PRESENT: Final = 0.9
GIVE_UP: Final = 0.005
_MOST: Final = 1000  # looks


@dataclass(frozen=True, slots=True)
class Manner:
    """Which parts of our way are in use."""

    on_the_way: bool = True  # pictures while driving
    whole_turns: bool = False  # looks are whole turns only
    everywhere: float = 0.1  # share of belief spread over all cells


class Touring:
    """One search."""

    def __init__(
        self, building: Building, start: int, weights: NDArray[np.float64], manner: Manner
    ) -> None:
        self._building, self._manner = building, manner
        self._looks, self._tourist = building.looks, building.tourist_of(manner.whole_turns)
        self._robot = building.robot(start)
        belief = belief_from(self._looks.cells, weights, 1 - PRESENT, everywhere=manner.everywhere)
        self._weight, self._absent = belief.weight, belief.absent
        self._memory = Memory(self._looks)
        self._stand: int | None = None

    @property
    def left(self) -> float:
        """Probability that it is still to be found."""
        mass = float(self._weight.sum())
        return mass / (mass + self._absent)

    def search(self, hidden: Hidden) -> Outcome:
        """Look until it is found or hardly likely to be there."""
        hidden.begin()
        robot = self._robot
        while robot.looks < _MOST and self.left > GIVE_UP:
            at = Standing(robot.cell, robot.heading, self._stand)
            look = self._tourist.best(at, self._weight, self._memory)
            if look is None:
                break
            if self._gone(look, hidden) or self._looked(look, hidden):
                return robot.outcome(True)
        return robot.outcome(False)

    def _gone(self, look: int, hidden: Hidden) -> bool:
        stand = int(self._looks.stand[look])
        watched = hidden if self._manner.on_the_way else None
        if self._robot.drive(self._looks.fields[stand], watched, self._seen_nothing):
            return True
        self._stand = stand
        return False

    def _looked(self, look: int, hidden: Hidden) -> bool:
        if int(self._looks.stands[self._looks.stand[look]]) != self._robot.cell:
            return False
        heading, extent = float(self._looks.heading[look]), float(self._looks.extent[look])
        if self._robot.turn_and_look(hidden, heading, extent):
            return True
        self._weight = self._weight * (1 - self._memory.chance(look))
        self._memory.note(look)
        return False

    def _seen_nothing(self, cell: int, heading: float) -> bool:
        chance = picture(self._looks, cell, heading)
        self._weight = self._weight * (1 - self._memory.of(cell, chance))
        self._memory.note_from(cell, chance)
        return False


def ours(
    building: Building,
    start: int,
    hidden: Hidden,
    chances: Mapping[int, float] | ArrayLike,
    manner: Manner | None = None,
) -> Outcome:
    """Search with `chances` (rooms,) that a room holds it."""
    looks = building.looks
    weights = room_weights(looks.space, looks.cells, chances)
    return Touring(building, start, weights, manner or Manner()).search(hidden)
