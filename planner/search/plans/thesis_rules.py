"""The thesis' search rule: the nearest goal first (section 3.4).

A plan is fixed beforehand: every failed view only removes a goal, so sorting again after each
failure gives the same order. Travel is along straight lines, with a fixed time at each stop.
Positions are (x, y) [m] in the map frame, times [s] since the start of the search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.semantic_map import SemanticMap
from planner.search.goals.search_goals import Goal, derive_goals, explain_none
from planner.settings import LOOK_AROUND, SPEED


@dataclass(frozen=True, slots=True, eq=False)
class PlanStep:
    """Step of a plan: one goal, with distance and time until it has been explored."""

    goal: Goal
    distance: float  # [m] travelled from the start of the search until here
    seconds: float  # [s] from the start of the search until this goal has been explored


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Goals in visiting order."""

    target: str
    start: NDArray[np.float64]  # (2,) [m] in the map frame
    steps: tuple[PlanStep, ...]
    expected_seconds: float | None  # given that the target is at a goal; None without goals
    explanation: str = ""  # reason why there are no goals; empty when there are some

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
) -> Plan:
    """The reference plan for `target`: the graph's goals, nearest first.

    `start` is (2,) [m], by default the robot's position, or the map's origin without a robot.
    Without goals the plan is empty and `explanation` has the reason. Raises UnknownCategoryError.
    """
    if start is None:
        robot = semantic_map.robot()
        start = np.zeros(2) if robot is None else robot.p_map[:2]
    goals = derive_goals(semantic_map, target)
    plan = nearest_first(start, goals, target=target, travel=travel)
    return plan if goals else replace(plan, explanation=explain_none(semantic_map, target))


def nearest_first(
    start: ArrayLike,
    goals: Sequence[Goal],
    *,
    target: str = "",
    travel: Travel | None = None,
) -> Plan:
    """The plan that always visits the nearest remaining goal next (thesis section 3.4, Fig. 3.16).

    `start` is (2,) [m]. Of equally near goals the more probable one comes first, then the smaller
    IRI.
    """
    preferred = sorted(goals, key=lambda goal: (-goal.probability, goal.iri))

    def metres(here: Goal | None, goal: Goal) -> float:
        return float(distances(start if here is None else here.p_map, goal.p_map)[0])

    order = list(nearest_neighbour(preferred, metres))
    return in_order(start, order, target=target, travel=travel)


def in_order(
    start: ArrayLike,
    goals: Sequence[Goal],
    *,
    target: str = "",
    travel: Travel | None = None,
) -> Plan:
    """The plan that visits `goals` in the order given, from `start` (2,) [m]."""
    begin = np.asarray(start, dtype=np.float64)
    stops = np.array([goal.p_map for goal in goals]).reshape(-1, 2)
    metres, arrivals = travelled(begin, stops), arrival_seconds(begin, stops, travel)
    steps = tuple(
        PlanStep(goal, float(m), float(s))
        for goal, m, s in zip(goals, metres, arrivals, strict=True)
    )
    expected = expected_seconds(arrivals, [goal.probability for goal in goals])
    return Plan(target, begin, steps, expected, "" if goals else f"nowhere to search for {target}")


T = TypeVar("T")


def nearest_neighbour(items: Iterable[T], metres: Callable[[T | None, T], float]) -> Iterator[T]:
    """Yields `items` in nearest-neighbour order; of equally near items, the first one first.

    `metres(here, item)` is the distance [m] from the item yielded last, None at the start. It is
    called again before each item, so that it may depend on the robot's position at that time.
    """
    left, here = list(items), None
    while left:
        distances = [metres(here, item) for item in left]
        here = left.pop(distances.index(min(distances)))
        yield here


@dataclass(frozen=True, slots=True)
class Travel:
    """Cost of moving and of looking around, fitted to the times of the thesis' Table 4.5.

    Raises ValueError for a speed that is not positive or a negative time.
    """

    speed: float = SPEED  # [m/s] on straight lines
    explore: float = LOOK_AROUND  # [s] to turn once and look at a place

    def __post_init__(self) -> None:
        if not self.speed > 0 or not self.explore >= 0:
            raise ValueError(f"speed must be > 0 and explore >= 0, got {self}")


def distances(p_from: ArrayLike, p_to: ArrayLike) -> NDArray[np.float64]:
    """Straight-line distances (n,) [m] from one position (2,) to each of (n, 2)."""
    offset = np.asarray(p_to, dtype=np.float64).reshape(-1, 2) - np.asarray(p_from, np.float64)
    return np.hypot(offset[:, 0], offset[:, 1])


def travelled(start: ArrayLike, stops: ArrayLike) -> NDArray[np.float64]:
    """Metres (n,) travelled from `start` (2,) until each of `stops` (n, 2), in their order."""
    points = np.vstack([np.reshape(start, (1, 2)), np.reshape(stops, (-1, 2))]).astype(np.float64)
    legs = np.diff(points, axis=0)
    return np.cumsum(np.hypot(legs[:, 0], legs[:, 1]))


def arrival_seconds(
    start: ArrayLike, stops: ArrayLike, travel: Travel | None = None
) -> NDArray[np.float64]:
    """Seconds (n,) until each of `stops` (n, 2) has been reached and explored, in their order."""
    travel = travel or Travel()
    metres = travelled(start, stops)
    return metres / travel.speed + travel.explore * np.arange(1, len(metres) + 1)


def expected_seconds(arrivals: ArrayLike, probabilities: ArrayLike) -> float | None:
    """Expected seconds until the first success, given that one of the stops succeeds.

    Stops with `arrivals` (n,) [s], in visiting order, and `probabilities` (n,) succeed
    independently: the mean of arrival(k) by p[k] prod_{j<k} (1 - p[j]). None when no stop has any
    probability.
    """
    p = np.asarray(probabilities, dtype=np.float64)
    first = p * np.cumprod(np.concatenate([[1.0], 1.0 - p[:-1]]))
    total = float(first.sum())
    return float(np.asarray(arrivals) @ (first / total)) if total > 0 else None
