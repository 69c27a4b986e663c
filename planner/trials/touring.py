"""Our way of searching: the hunt of `find` and `search`, on what is believed of rooms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from planner.finding.ground import Ground
from planner.finding.hunt import Hunt
from planner.finding.prospects import Prospects
from planner.finding.settings import BELIEF
from planner.finding.targets import Target
from planner.trials.building import Building
from planner.trials.hidden import Hidden
from planner.trials.robot import Outcome
from planner.viewing.belief import CellBelief, belief_from, room_weights
from planner.viewing.looks import Looks
from planner.viewing.tour import Standing

#: Probability that it is there at all, before the search.
PRESENT: Final = 0.9
_MOST: Final = 5000  # looks and pictures


@dataclass(frozen=True, slots=True)
class Manner:
    """Which parts of our way are in use."""

    on_the_way: bool = True  # pictures while driving
    whole_turns: bool = False  # looks are whole turns only
    everywhere: float = 0.1  # share of belief spread over all cells
    give_up_at: float = BELIEF.rest  # chance that looks missed a thing, at which to give up


class Touring:
    """One search."""

    def __init__(self, building: Building, start: int, hunt: Hunt, manner: Manner) -> None:
        self._manner, self._hunt = manner, hunt
        self._robot = building.robot(start)
        self._stand: int | None = None

    def search(self, hidden: Hidden) -> Outcome:
        """Look until it is found or no look is worth the way."""
        hidden.begin()
        robot = self._robot
        while robot.looks < _MOST:
            look = self._hunt.next(Standing(robot.cell, robot.heading, self._stand))
            if look is None:
                break
            if self._gone(look, hidden) or self._looked(look, hidden):
                return robot.outcome(True)
        return robot.outcome(False)

    def _gone(self, look: int, hidden: Hidden) -> bool:
        looks = self._hunt.looks
        stand = int(looks.stand[look])
        watched = hidden if self._manner.on_the_way else None
        if self._robot.drive(looks.fields[stand], watched, self._seen_nothing):
            return True
        self._stand = stand
        return False

    def _looked(self, look: int, hidden: Hidden) -> bool:
        looks = self._hunt.looks
        heading, extent = float(looks.heading[look]), float(looks.extent[look])
        if self._robot.turn_and_look(hidden, heading, extent):
            return True
        self._hunt.missed(look)
        return False

    def _seen_nothing(self, cell: int, heading: float) -> bool:
        self._hunt.missed_picture(cell, heading)
        return False


def ours(
    building: Building,
    start: int,
    hidden: Hidden,
    chances: Mapping[int, float] | ArrayLike,
    manner: Manner | None = None,
) -> Outcome:
    """Search with `chances` (rooms,) that a room holds it."""
    manner = manner or Manner()
    looks = building.whole_turns if manner.whole_turns else building.looks
    weights = room_weights(looks.space, looks.cells, chances)
    belief = belief_from(looks.cells, weights, 1 - PRESENT, everywhere=manner.everywhere)
    return Touring(building, start, _hunt(building, looks, belief, manner), manner).search(hidden)


def _hunt(building: Building, looks: Looks, belief: CellBelief, manner: Manner) -> Hunt:
    """A hunt for one thing that lies where `belief` has it."""
    thing = Target("it", "it", None, {}, {})
    nameless = ("",) * (int(looks.space.room.max()) + 1)
    known = Prospects(looks.cells, belief.weight[np.newaxis], np.zeros(1, np.intp), ())
    ground = Ground(looks.space, nameless, nameless)
    settings = replace(BELIEF, rest=manner.give_up_at)
    return Hunt((thing,), ground, looks, (), known, settings, building.fresh)
