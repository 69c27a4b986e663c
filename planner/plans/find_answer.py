"""The answer to "where is it?" as plain values, for programs: the known objects and the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kg.maps.semantic_map import SemanticMap
from planner.goals.known_objects import known_json
from planner.goals.targets import resolve
from planner.plans.report import plan_json
from planner.plans.search_state import build_search
from planner.plans.view_plan import plan


def find_answer(semantic_map: SemanticMap, wanted: Sequence[str]) -> dict[str, object]:
    """What `find --json` prints for `wanted`, by default settings from where the robot is.

    Raises QueryParameterError for what is no object, UnknownCategoryError for an unknown word.
    """
    state = build_search(semantic_map, wanted)
    if state is None:
        return empty_answer([target.label for target in resolve(semantic_map, wanted)])
    robot = semantic_map.robot()
    start = (0.0, 0.0) if robot is None else (float(robot.p_map[0]), float(robot.p_map[1]))
    heading = 0.0 if robot is None else robot.heading
    found = plan(state, start, heading=heading, time_limit=math.inf)
    return {**plan_json(found), "known": known_json(semantic_map, state.targets)}


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
