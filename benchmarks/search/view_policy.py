"""View policy: the search of `find` and `search`, with a belief over rooms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.robot import TrialOutcome
from benchmarks.search.room_beliefs import belief_from, room_weights
from planner.freespace.planning_map import PlanningMap
from planner.search.belief import TargetBelief
from planner.search.goals.targets import Target
from planner.search.plans.search_state import PlanningState
from planner.search.viewpoints.candidate_views import CandidateViews
from planner.search.viewpoints.next_best_view import RobotState
from planner.settings import BELIEF

#: Probability that the object is in the home, before the search.
PRESENT: Final = 0.9
_MAX_VIEWS: Final = 5000  # views and pictures


@dataclass(frozen=True, slots=True)
class Ablation:
    """Parts of the view policy that are in use."""

    on_the_way: bool = True  # pictures while driving
    whole_turns: bool = False  # views are whole turns only
    everywhere: float = 0.1  # share of belief spread over all cells
    give_up_at: float = BELIEF.stop_below  # chance that views missed it, at which to give up


class ViewPolicy:
    """One search."""

    def __init__(
        self, building: HomeSpace, start: int, state: PlanningState, manner: Ablation
    ) -> None:
        self._manner, self._state = manner, state
        self._robot = building.robot(start)
        self._viewpoint: int | None = None

    def search(self, hidden: HiddenObject) -> TrialOutcome:
        """Take views until the object is found or no view gains enough."""
        hidden.begin()
        robot = self._robot
        while robot.looks < _MAX_VIEWS:
            look = self._state.next_view(RobotState(robot.cell, robot.heading, self._viewpoint))
            if look is None:
                break
            if self._gone(look, hidden) or self._looked(look, hidden):
                return robot.outcome(True)
        return robot.outcome(False)

    def _gone(self, look: int, hidden: HiddenObject) -> bool:
        views = self._state.views
        viewpoint = int(views.viewpoint[look])
        watched = hidden if self._manner.on_the_way else None
        if self._robot.drive(views.fields[viewpoint], watched, self._seen_nothing):
            return True
        self._viewpoint = viewpoint
        return False

    def _looked(self, look: int, hidden: HiddenObject) -> bool:
        views = self._state.views
        heading, extent = float(views.heading[look]), float(views.extent[look])
        if self._robot.turn_and_look(hidden, heading, extent):
            return True
        self._state.missed(look)
        return False

    def _seen_nothing(self, cell: int, heading: float) -> bool:
        self._state.missed_picture(cell, heading)
        return False


def ours(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    chances: Mapping[int, float] | ArrayLike,
    manner: Ablation | None = None,
) -> TrialOutcome:
    """Search with `chances` (rooms,) that the object is in a room."""
    manner = manner or Ablation()
    views = building.whole_turns if manner.whole_turns else building.views
    weights = room_weights(views.space, views.cells, chances)
    belief = belief_from(views.cells, weights, 1 - PRESENT, everywhere=manner.everywhere)
    state = initial_state(building, views, belief.weight[np.newaxis], manner)
    return ViewPolicy(building, start, state, manner).search(hidden)


def initial_state(
    building: HomeSpace, views: CandidateViews, weight: NDArray[np.float64], manner: Ablation
) -> PlanningState:
    """Planning state for k instances of a target with belief `weight` (k, c)."""
    thing = Target("it", "it", None, {}, {})
    nameless = ("",) * (int(views.space.room.max()) + 1)
    known = TargetBelief(views.cells, weight, np.zeros(len(weight), np.intp), ())
    ground = PlanningMap(views.space, nameless, nameless)
    settings = replace(BELIEF, stop_below=manner.give_up_at)
    return PlanningState((thing,), ground, views, (), known, settings, building.fresh)
