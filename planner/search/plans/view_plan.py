"""View plan: viewpoints in order for a planning state, with reasons, expected times and the way."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.model.errors import LayoutError
from kg.model.records import RobotRecord
from planner.freespace.geodesic import distance_fields, shortest_path
from planner.search.goals.candidate_queries import Candidate
from planner.search.plans.rollout import PlanEvaluator, Rollout
from planner.search.plans.search_state import PlanningState, ViewReason
from planner.search.viewpoints.candidate_views import angle_between
from planner.search.viewpoints.next_best_view import RobotState
from planner.settings import TRIALS, WORTH

SHOWN = 5  # steps of a printed plan
Start = tuple[float, float, float]  # x, y [m], heading [rad]


@dataclass(frozen=True, slots=True, eq=False)
class ViewStep:
    """One view of a plan."""

    view: int  # number in the state's candidate views
    p_map: NDArray[np.float64]  # (2,) [m] viewpoint
    heading: float  # [rad] the middle of the view
    extent: float  # [rad] seen in one sweep
    place: str  # IRI of the place it is in; "" for none
    place_name: str
    why: tuple[ViewReason, ...]  # the weightiest first
    probability: float  # to find the target here first; of several targets, any of them
    finds: float  # expected number of targets first found here
    seconds: float  # [s] from the start of the search to the end of this view
    metres: float  # [m] driven until then
    cost: float  # [s] of the way, the turn and the view
    left: float  # probability that a target is on this floor and not found yet


@dataclass(frozen=True, slots=True, eq=False)
class VisitedCandidate:
    """A candidate, and the time at which the plan shows it."""

    candidate: Candidate
    metres: float | None  # [m] driven until then; None where no view of the plan shows it
    seconds: float | None


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlan:
    """View plan: views in order with their gains."""

    targets: tuple[str, ...]
    start: NDArray[np.float64]  # (2,) [m]
    steps: tuple[ViewStep, ...]
    goals: tuple[VisitedCandidate, ...]  # in visiting order
    expected_seconds: float | None  # given that it is found; None where there is no step
    probability: float  # to find it along the plan; of several targets, any of them
    finds: float  # expected number of targets found
    present: float  # probability that any target is on this floor, before the first view
    best: float  # greatest probability of a view, also of those that were left out
    note: str = ""  # where the start is off the floor

    def __str__(self) -> str:
        """The plan in sentences: its chance and time, then its first looks with their reasons."""
        from planner.search.plans.report import plan_lines, step_lines

        told, *more = [*plan_lines(self), *step_lines(self.steps[:SHOWN])]
        return "\n".join([f"{', '.join(self.targets)}: {told}", *more])


def plan(
    state: PlanningState,
    start: RobotState | ArrayLike,
    *,
    heading: float = 0.0,
    budget: float | None = None,
    seed: int = 0,
    time_limit: float = 0.3,
    trials: int = TRIALS,
    worth: float = WORTH,
) -> ViewPlan:
    """Plan of views that find the targets of `state` in little expected time.

    The plan is built by the ratio rule and improved by seeded trials. Views of little probability
    are left out, and views that repeat the one before. `state` is not changed.

    Args:
        state: The planning state.
        start: A robot state, or a position (2,) [m]. From a position off the floor the robot first
            drives to the floor in a straight line.
        heading: Heading of the robot at a position [rad].
        budget: Time after which the plan ends [s].
        seed: Seed of the trials.
        time_limit: Computing time for the trials [s]; if infinite, the plan is the same on every
            machine.
        trials: Number of trials.
        worth: Least probability of a view to find a target, 0..1.
    Raises:
        QueryParameterError: the position is too far from the floor to belong to the building.
    """
    note = "" if isinstance(start, RobotState) else state.space.off_floor(start)
    begin, at, before = _begin(state, start, heading)
    evaluator = PlanEvaluator(state, at, before / state.views.motion.speed)
    limit = math.inf if budget is None else budget
    order = evaluator.construct(limit) if state.wanted else []
    order = evaluator.improve(order, trials, time.monotonic() + time_limit, seed)
    first = evaluator.play(order)
    rollout = _worthwhile(evaluator, first, worth)
    steps = _steps(state, rollout, before)
    return ViewPlan(
        targets=tuple(state.targets[i].label for i in state.wanted),
        start=begin,
        steps=steps,
        goals=_visited(state, steps),
        expected_seconds=rollout.expected_seconds if steps else None,
        probability=float(1.0 - np.prod(1.0 - rollout.found[-1])),
        finds=float(rollout.gains.sum()),
        present=state.left,
        best=float(first.chances.max(initial=0.0)),
        note=note and f"{note}, from where the plan goes on",
    )


def _worthwhile(evaluator: PlanEvaluator, rollout: Rollout, worth: float) -> Rollout:
    """The rollout without views of less than `worth`, and without repeated ones.

    Without one view the others find more, so that the least comes out first.
    """
    while len(rollout.views):
        again = [i for i in range(1, len(rollout.views)) if _repeats(evaluator, rollout, i)]
        least = int(np.argmin(rollout.chances))
        if not again and rollout.chances[least] >= worth:
            return rollout
        out = again[-1] if again else least
        rollout = evaluator.play([*rollout.views[:out], *rollout.views[out + 1 :]])
    return rollout


def _repeats(evaluator: PlanEvaluator, rollout: Rollout, number: int) -> bool:
    """Whether a view shows again, from the same place, what the view before has in its middle."""
    views, (before, view) = evaluator.state.views, rollout.views[number - 1 : number + 1]
    if views.viewpoint[before] != views.viewpoint[view]:
        return False
    off = angle_between(views.heading[before], views.heading[view])
    return bool(off < max(views.extent[before], views.extent[view]) / 2)


def _begin(
    state: PlanningState, start: RobotState | ArrayLike, heading: float
) -> tuple[NDArray[np.float64], RobotState, float]:
    """Position [m], robot state, and metres to drive before the floor is reached."""
    if isinstance(start, RobotState):
        return state.space.centres([start.cell])[0], start, 0.0
    p_map = np.asarray(start, np.float64)[:2]
    at = state.robot_state(p_map, heading)
    off = float(np.linalg.norm(state.space.centres([at.cell])[0] - p_map))
    return p_map, at, off if off > 2 * state.space.cell else 0.0


def _steps(state: PlanningState, rollout: Rollout, before: float) -> tuple[ViewStep, ...]:
    views, revisits, steps = state.views, state.revisits.copy(), list[ViewStep]()
    held = np.array(
        [state.target_belief.left(state.unseen, [n]) for n in range(len(state.targets))]
    )
    left = 1.0 - np.prod(1.0 - np.maximum(held - rollout.found, 0.0)[:, list(state.wanted)], axis=1)
    costs = np.diff(rollout.arrivals, prepend=0.0)
    for i, view in enumerate(rollout.views):
        steps.append(
            ViewStep(
                view=view,
                p_map=state.space.centres([views.viewpoints[views.viewpoint[view]]])[0],
                heading=float(views.heading[view]),
                extent=float(views.extent[view]),
                place=state.place_of(view),
                place_name=state.place_name(view),
                why=state.why(view, rollout.unseen[i], revisits),
                probability=float(rollout.chances[i]),
                finds=float(rollout.gains[i]),
                seconds=float(rollout.arrivals[i]),
                metres=float(rollout.metres[i]) + before,
                cost=float(costs[i]),
                left=float(left[i + 1]),
            )
        )
        revisits.add(view)
    return tuple(steps)


def _visited(state: PlanningState, steps: Iterable[ViewStep]) -> tuple[VisitedCandidate, ...]:
    """Every candidate with some probability, in the order in which the steps show it."""
    wanted = set(state.wanted)
    rest = [c for c in state.candidates if c.target in wanted and c.probability > 0]
    rest.sort(key=lambda c: (-c.probability, c.iri))
    cells, visited = state.views.cells, list[VisitedCandidate]()
    nearest = [state.space.nearest(candidate.p_map) for candidate in rest]
    number = np.minimum(np.searchsorted(cells, nearest), len(cells) - 1)
    cell_of = {id(candidate): int(cell) for candidate, cell in zip(rest, number, strict=True)}

    def shows(step: ViewStep, candidate: Candidate) -> bool:
        if candidate.kind in ("place", "frontier"):
            return step.place == candidate.iri
        return bool(seen[cell_of[id(candidate)]] > 0)

    for step in steps:
        seen = state.views.chance[step.view]
        shown = [candidate for candidate in rest if shows(step, candidate)]
        visited += [VisitedCandidate(c, step.metres, step.seconds) for c in shown]
        rest = [candidate for candidate in rest if candidate not in shown]
    return (*visited, *(VisitedCandidate(candidate, None, None) for candidate in rest))


def planned_ways(
    state: PlanningState, plan: ViewPlan, steps: Sequence[ViewStep]
) -> list[NDArray[np.float64]]:
    """The way (n, 2) [m] to each of `steps`, which are the first ones of `plan`."""
    views, cell = state.views, state.space.nearest(plan.start)
    ends = views.viewpoints[views.viewpoint[[step.view for step in steps]]] if steps else ()
    ways = []
    for there, field in zip(map(int, ends), distance_fields(state.space, ends), strict=True):
        try:
            cells = shortest_path(state.space, field, cell)
        except LayoutError:  # the only way is a passage between cells that are no floor
            cells = np.array([cell, there], np.intp)
        ways.append(_smooth(state.space.centres(cells)))
        cell = there
    return ways


def planned_route(
    state: PlanningState, plan: ViewPlan, steps: Sequence[ViewStep]
) -> NDArray[np.float64]:
    """(n, 2) [m] the whole way from the start over the stops of `steps`."""
    return np.concatenate([plan.start[None, :], *planned_ways(state, plan, steps)])


def _smooth(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) each point replaced by the mean of up to five neighbours; the ends are kept."""
    if len(points) < 5:
        return points
    padded = np.vstack([points[:1], points[:1], points, points[-1:], points[-1:]])
    mean = np.mean([padded[i : i + len(points)] for i in range(5)], axis=0)
    mean[0], mean[-1] = points[0], points[-1]
    return np.asarray(mean, np.float64)


def plan_from(
    state: PlanningState,
    start: Start | None = None,
    *,
    budget: float | None = None,
    worth: float = WORTH,
) -> ViewPlan:
    """The plan on `state` from `start`, by default the robot's pose; the same on every machine."""
    robot = None if state.facts is None else state.facts.robot
    x, y, heading = start or robot_start(robot)
    return plan(
        state,
        (x, y),
        heading=heading,
        budget=budget,
        time_limit=math.inf,
        worth=worth,
    )


def robot_start(robot: RobotRecord | None) -> Start:
    """Pose of the robot; the map's origin while it has none."""
    if robot is None:
        return 0.0, 0.0, 0.0
    return float(robot.p_map[0]), float(robot.p_map[1]), robot.heading
