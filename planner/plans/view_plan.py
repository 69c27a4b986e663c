"""View plan: views in order for a planning state, with reasons and expected times."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.goals.candidate_queries import Candidate
from planner.plans.baselines import Baseline, room_baselines
from planner.plans.rollout import PlanEvaluator, Rollout
from planner.plans.search_state import PlanningState, ViewReason
from planner.settings import ENOUGH, IDLE, LEAST_CHANCE, MOST_LOOKS, TRIALS
from planner.viewpoints.next_best_view import RobotState


@dataclass(frozen=True, slots=True, eq=False)
class ViewStep:
    """One look of a plan."""

    view: int  # number in the state's candidate views
    p_map: NDArray[np.float64]  # (2,) [m] viewpoint
    heading: float  # [rad] the middle of what is looked at
    extent: float  # [rad] seen in one sweep
    place: str  # IRI of the place it is in; "" for none
    place_name: str
    why: tuple[ViewReason, ...]  # the weightiest first
    probability: float  # to find it here and not before; of several targets, finds expected here
    seconds: float  # [s] since the start of the search when this look is over
    metres: float  # [m] driven until then
    cost: float  # [s] this step takes: the way, the turn, the look
    left: float  # probability to be on this floor and not found by then; of several, finds left


@dataclass(frozen=True, slots=True, eq=False)
class VisitedCandidate:
    """A candidate, and when the plan gets to it."""

    candidate: Candidate
    metres: float | None  # [m] driven until then; None where no look of the plan shows it
    seconds: float | None


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlan:
    """A search: looks in order with what each brings, and how good the order is."""

    targets: tuple[str, ...]
    start: NDArray[np.float64]  # (2,) [m]
    steps: tuple[ViewStep, ...]
    goals: tuple[VisitedCandidate, ...]  # in visiting order
    expected_seconds: float | None  # given that it is found; None where there is no step
    probability: float  # to find it along the plan; of several targets, finds expected
    present: float  # probability that any of it is on this floor, before the first look
    baselines: tuple[Baseline, ...] = ()


def plan(
    state: PlanningState,
    start: RobotState | ArrayLike,
    *,
    heading: float = 0.0,
    budget: float | None = None,
    seed: int = 0,
    time_limit: float = 0.3,
    trials: int = TRIALS,
    compare: bool = True,
) -> ViewPlan:
    """Looks that find what `state` still wants in little expected time, from `start` on.

    `start` is a robot state, or a position (2,) [m] where it faces `heading` [rad]; from
    off the floor it drives to it in a straight line first. `budget` [s] ends the plan. Built by the
    ratio rule, then improved by seeded `trials`, as far as `time_limit` [s] lets them: infinite,
    the plan is the same on every machine. With `compare` other ways to search are rated beside it.
    `state` stays as it is.
    """
    begin, at, before = _begin(state, start, heading)
    evaluator = PlanEvaluator(state, at, before / state.views.motion.speed)
    limit = math.inf if budget is None else budget
    order = evaluator.construct(ENOUGH, MOST_LOOKS, limit) if state.wanted else []
    order = evaluator.improve(order, trials, time.monotonic() + time_limit, seed)
    rollout = _without_idle_looks(evaluator, evaluator.play(order))
    steps = _steps(state, rollout, before)
    found = float(rollout.gains.sum())
    return ViewPlan(
        targets=tuple(state.targets[i].label for i in state.wanted),
        start=begin,
        steps=steps,
        goals=_visited(state, steps),
        expected_seconds=rollout.expected_seconds if steps else None,
        probability=found,
        present=state.left,
        baselines=room_baselines(evaluator, rollout) if steps and compare else (),
    )


def _without_idle_looks(evaluator: PlanEvaluator, rollout: Rollout) -> Rollout:
    """The rollout without looks that find next to nothing of what all looks find."""
    worth = rollout.gains >= max(IDLE * float(rollout.gains.sum()), LEAST_CHANCE)
    if bool(worth.all()) or not worth.any():
        return rollout
    return evaluator.play([view for view, kept in zip(rollout.views, worth, strict=True) if kept])


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
    views, revisits, steps = state.views, state.revisits, list[ViewStep]()
    trial = revisits.copy()
    previous = 0.0
    found, all_of_it = np.cumsum(rollout.gains), state.expected_finds
    try:
        state.revisits = trial
        for i, view in enumerate(rollout.views):
            why = state.why(view, rollout.unseen[i])
            trial.add(view)
            steps.append(
                ViewStep(
                    view=view,
                    p_map=state.space.centres([views.viewpoints[views.viewpoint[view]]])[0],
                    heading=float(views.heading[view]),
                    extent=float(views.extent[view]),
                    place=state.place_of(view),
                    place_name=state.place_name(view),
                    why=why,
                    probability=float(rollout.gains[i]),
                    seconds=float(rollout.arrivals[i]),
                    metres=float(rollout.metres[i]) + before,
                    cost=float(rollout.arrivals[i]) - previous,
                    left=max(all_of_it - float(found[i]), 0.0),
                )
            )
            previous = float(rollout.arrivals[i])
    finally:
        state.revisits = revisits
    return tuple(steps)


def _visited(state: PlanningState, steps: Iterable[ViewStep]) -> tuple[VisitedCandidate, ...]:
    """Every candidate with some probability, in the order the steps get to see it."""
    wanted = set(state.wanted)
    open_ = [VisitedCandidate(c, None, None) for c in state.candidates if c.target in wanted]
    open_ = [v for v in open_ if v.candidate.probability > 0]
    open_.sort(key=lambda v: (-v.candidate.probability, v.candidate.iri))
    cells, done = state.views.cells, list[VisitedCandidate]()
    at = {id(v): int(np.searchsorted(cells, state.space.nearest(v.candidate.p_map))) for v in open_}
    for step in steps:
        chance = state.views.chance[step.view]
        for one in list(open_):
            if _gets_to(step, one.candidate, float(chance[min(at[id(one)], len(cells) - 1)])):
                open_.remove(one)
                done.append(replace(one, metres=step.metres, seconds=step.seconds))
    return (*done, *open_)


def _gets_to(step: ViewStep, candidate: Candidate, chance: float) -> bool:
    if candidate.kind in ("place", "frontier"):
        return step.place == candidate.iri
    return chance > 0
