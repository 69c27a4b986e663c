"""View policy: the search of `find` and `search`, with a belief over rooms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.robot import TrialOutcome
from benchmarks.search.room_beliefs import RoomChances, room_belief
from planner.freespace.planning_map import PlanningMap
from planner.search.goals.targets import Target
from planner.search.plans.search_state import PlanningState
from planner.search.viewpoints.candidate_views import CandidateViews, sweep_over
from planner.search.viewpoints.next_best_view import RobotState
from planner.settings import BELIEF

_MAX_VIEWS: Final = 5000  # views and pictures


@dataclass(frozen=True, slots=True, kw_only=True)
class Ablation:
    """Parts of the view policy that are in use."""

    apart: float = 0.0  # [m] driven at least between pictures on the way; infinite for none
    whole_turns: bool = False  # views are whole turns only
    everywhere: float = 0.1  # share of belief spread over all cells
    give_up_at: float = BELIEF.stop_below  # chance that views missed it, at which to give up


class ViewPolicy:
    """One search."""

    def __init__(
        self, building: HomeSpace, start: int, state: PlanningState, manner: Ablation
    ) -> None:
        self._manner, self._state = manner, state
        self.robot = building.robot(start)

    def search(self, hidden: HiddenObject) -> TrialOutcome:
        """Take views until the object is found or no view gains enough."""
        hidden.begin()
        robot = self.robot
        while robot.looks < _MAX_VIEWS:
            look = self._next()
            if look is None:
                break
            if self._gone(look, hidden):
                return robot.outcome(True)
            best = self._next()  # pictures on the way count now
            if best is None:
                break
            if self._gone(best, hidden) or self._looked(best, hidden):
                return robot.outcome(True)
        return robot.outcome(False)

    def _next(self) -> int | None:
        robot = self.robot
        return self._state.next_view(RobotState(robot.cell, robot.heading))

    def _gone(self, look: int, hidden: HiddenObject) -> bool:
        views = self._state.views
        field = views.ways.field(int(views.viewpoints[views.viewpoint[look]]))
        return self.robot.drive(field, hidden, self._seen_nothing, self._manner.apart)

    def _looked(self, look: int, hidden: HiddenObject) -> bool:
        views = self._state.views
        heading, extent = float(views.heading[look]), float(views.extent[look])
        robot = self.robot
        sweep = sweep_over(robot.heading, heading, extent, robot.sensor.field_of_view)
        if robot.sweep(hidden, sweep):
            return True
        self._state.missed_sweep(robot.cell, sweep.middle, sweep.extent)
        return False

    def _seen_nothing(self, cell: int, heading: float) -> bool:
        self._state.missed_sweep(cell, heading, self.robot.sensor.field_of_view)
        return False


def ours(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    rooms: RoomChances,
    manner: Ablation | None = None,
) -> TrialOutcome:
    """Search with the chances of `rooms` to hold the object."""
    manner = manner or Ablation()
    views = building.whole_turns if manner.whole_turns else building.views
    state = initial_state(building, views, rooms, manner)
    return ViewPolicy(building, start, state, manner).search(hidden)


def initial_state(
    building: HomeSpace, views: CandidateViews, rooms: RoomChances, manner: Ablation
) -> PlanningState:
    """Planning state for a target that `rooms` may hold."""
    thing = Target("it", "it", None, {}, {})
    nameless = ("",) * (int(views.space.room.max()) + 1)
    known = room_belief(views.space, views.cells, rooms, manner.everywhere)
    ground = PlanningMap(views.space, nameless, nameless)
    settings = replace(BELIEF, stop_below=manner.give_up_at)
    return PlanningState((thing,), ground, views, (), known, settings, building.fresh)
