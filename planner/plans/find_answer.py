"""The answer to "where is it?" as plain values, for programs: the known objects and the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kg.maps.semantic_map import SemanticMap
from planner.goals.known_objects import known_json
from planner.goals.targets import resolve
from planner.plans.report import plan_json
from planner.plans.route import planned_ways
from planner.plans.search_state import PlanningState, build_search
from planner.plans.view_plan import ViewPlan, plan

Start = tuple[float, float, float]  # x, y [m], heading [rad]


def find_answer(semantic_map: SemanticMap, wanted: Sequence[str]) -> dict[str, object]:
    """What `find --json` prints for `wanted`, by default settings from where the robot is.

    Raises QueryParameterError for what is no object, UnknownCategoryError for an unknown word.
    """
    state = build_search(semantic_map, wanted)
    if state is None:
        return empty_answer([target.label for target in resolve(semantic_map, wanted)])
    return answer_json(semantic_map, state, plan_from(semantic_map, state))


def answer_json(
    semantic_map: SemanticMap, state: PlanningState, found: ViewPlan
) -> dict[str, object]:
    """A plan with its ways, and what the map has of its targets, as plain values."""
    ways = planned_ways(state, found, found.steps)
    return {**plan_json(found, ways), "known": known_json(semantic_map, state.targets)}


def planned(
    semantic_map: SemanticMap, wanted: Sequence[str], start: Start | None = None
) -> ViewPlan | None:
    """The plan for `wanted` by default settings, from `start` or from where the robot is.

    None for a map without floor. Raises as `find_answer`.
    """
    state = build_search(semantic_map, wanted)
    return None if state is None else plan_from(semantic_map, state, start)


def plan_from(
    semantic_map: SemanticMap,
    state: PlanningState,
    start: Start | None = None,
    *,
    budget: float | None = None,
    compare: bool = True,
) -> ViewPlan:
    """The plan on `state` from `start` or from where the robot is, as `plan` makes it."""
    x, y, heading = start or robot_start(semantic_map)
    return plan(state, (x, y), heading=heading, budget=budget, time_limit=math.inf, compare=compare)


def robot_start(semantic_map: SemanticMap) -> Start:
    """Where the robot is; the map's origin while it is nowhere."""
    robot = semantic_map.robot()
    if robot is None:
        return 0.0, 0.0, 0.0
    return float(robot.p_map[0]), float(robot.p_map[1]), robot.heading


def empty_answer(targets: Sequence[str]) -> dict[str, object]:
    """The answer of a map without floor, where there is nowhere to look."""
    return {
        "target": ", ".join(targets),
        "targets": list(targets),
        "goals": [],
        "expected_seconds": None,
        "probability": 0.0,
        "present": 0.0,
        "steps": [],
        "alternatives": [],
        "known": [],
    }
