"""Baseline search rules of the thesis: nearest goal first, and brute force (sections 3.4, 4.4).

A plan is fixed beforehand: as every failed look only removes a goal, sorting again after each
failure gives the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.semantic_map import SemanticMap
from kg.records import PlaceRecord
from planner.freespace.travel import (
    SearchModel,
    Travel,
    arrival_seconds,
    distances,
    expected_seconds,
    travelled,
)
from planner.goals.search_goals import Goal, derive_goals, explain_none
from planner.plans.nearest_neighbour import nearest_neighbour


@dataclass(frozen=True, slots=True, eq=False)
class PlanStep:
    """Step of a plan: one goal, and what it costs to get there."""

    goal: Goal
    distance: float  # [m] travelled from the start of the search until here
    seconds: float  # [s] from the start of the search until this goal has been explored


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Goals in visiting order with what each costs."""

    target: str
    start: NDArray[np.float64]  # (2,) [m] in the map frame
    steps: tuple[PlanStep, ...]
    expected_seconds: float | None  # given that a goal has it; None when there are no goals
    explanation: str = ""  # why there are no goals; empty when there are

    def to_json(self) -> dict[str, object]:
        """The plan as plain values, goals in visiting order; lengths to 1 mm, times to 1 ms."""
        expected = self.expected_seconds
        return {
            "target": self.target,
            "goals": [_step_json(step) for step in self.steps],
            "expected_seconds": None if expected is None else round(expected, 3),
        }


def _step_json(step: PlanStep) -> dict[str, object]:
    goal = step.goal
    return {
        "iri": goal.iri,
        "kind": goal.kind,
        "x": round(float(goal.p_map[0]), 3),
        "y": round(float(goal.p_map[1]), 3),
        "probability": round(goal.probability, 6),
        "why": goal.why,
        "distance": round(step.distance, 3),
        "seconds": round(step.seconds, 3),
    }


def plan_search(
    semantic_map: SemanticMap,
    target: str,
    start: ArrayLike | None = None,
    *,
    travel: Travel | None = None,
    model: SearchModel = "any",
) -> Plan:
    """The reference plan for `target`: the graph's goals, nearest first.

    `start` is (2,) [m], by default where the robot is, or the map's origin while it is nowhere.
    Without goals the plan is empty and its `explanation` says why. Raises UnknownCategoryError.
    """
    if start is None:
        robot = semantic_map.robot()
        start = np.zeros(2) if robot is None else robot.p_map[:2]
    goals = derive_goals(semantic_map, target)
    plan = nearest_first(start, goals, target=target, travel=travel, model=model)
    return plan if goals else replace(plan, explanation=explain_none(semantic_map, target))


def nearest_first(
    start: ArrayLike,
    goals: Sequence[Goal],
    *,
    target: str = "",
    travel: Travel | None = None,
    model: SearchModel = "any",
) -> Plan:
    """Always on to the nearest goal that remains, by straight line (thesis section 3.4, Fig. 3.16).

    `start` is (2,) [m]. Of goals equally near the more probable comes first, then the smaller IRI.
    `model` says how the goals' probabilities hang together (`planner.freespace.travel`).
    """
    preferred = sorted(goals, key=lambda goal: (-goal.probability, goal.iri))

    def metres(here: Goal | None, goal: Goal) -> float:
        return float(distances(start if here is None else here.p_map, goal.p_map)[0])

    order = list(nearest_neighbour(preferred, metres))
    return in_order(start, order, target=target, travel=travel, model=model)


def brute_force(
    start: ArrayLike,
    places: Sequence[PlaceRecord],
    *,
    target: str = "",
    travel: Travel | None = None,
) -> Plan:
    """The thesis' baseline: on to the nearest place centre that remains, exploring every place.

    Knows no relations, so every place is as probable as any other. "Every place where it passes
    into" (section 4.4) is read as every place travelled to: see `docs/research/table_4_5.md`.
    """
    goals = [
        Goal(
            iri=place.iri,
            kind="place",
            label=place.label,
            p_map=np.array(place.area.centre),
            probability=1 / len(places),
            why=f"{place.label} is one of {len(places)} places, and brute force explores them all",
        )
        for place in places
    ]
    return nearest_first(start, goals, target=target, travel=travel, model="single")


def in_order(
    start: ArrayLike,
    goals: Sequence[Goal],
    *,
    target: str = "",
    travel: Travel | None = None,
    model: SearchModel = "any",
) -> Plan:
    """The plan that visits `goals` in the order given, from `start` (2,) [m]."""
    begin = np.asarray(start, dtype=np.float64)
    stops = np.array([goal.p_map for goal in goals]).reshape(-1, 2)
    metres, arrivals = travelled(begin, stops), arrival_seconds(begin, stops, travel)
    steps = tuple(
        PlanStep(goal, float(m), float(s))
        for goal, m, s in zip(goals, metres, arrivals, strict=True)
    )
    expected = expected_seconds(arrivals, [goal.probability for goal in goals], model)
    return Plan(target, begin, steps, expected, "" if goals else f"nowhere to search for {target}")
