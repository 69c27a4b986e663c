"""Execution of a plan of goals against a hidden truth (thesis section 4.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from planner.search.goals.search_goals import Goal
from planner.search.plans.thesis_rules import Plan, distances

#: The author's finder counts an object as found when it is detected nearer than this [m].
FOUND_WITHIN = 2.80


@dataclass(frozen=True, slots=True, eq=False)
class RuleOutcome:
    """Outcome of a plan carried out."""

    found: Goal | None  # the goal where it was found, None when all were explored in vain
    explored: int  # goals explored, the one where it was found included
    distance: float  # [m] travelled
    seconds: float  # [s] spent


def follow(plan: Plan, present: Callable[[Goal], bool]) -> RuleOutcome:
    """Visit the goals of `plan` until one shows what is hidden.

    `present` knows the truth: `in_place` and `within` make it from a hidden place or position.
    """
    for number, step in enumerate(plan.steps, start=1):
        if present(step.goal):
            return RuleOutcome(step.goal, number, step.distance, step.seconds)
    if not plan.steps:
        return RuleOutcome(None, 0, 0.0, 0.0)
    return RuleOutcome(None, len(plan.steps), plan.steps[-1].distance, plan.steps[-1].seconds)


def in_place(iri: str) -> Callable[[Goal], bool]:
    """The hidden object is in the place `iri`; exploring that place shows it (section 4.4)."""
    return lambda goal: goal.iri == iri


def within(p_map: ArrayLike, reach: float = FOUND_WITHIN) -> Callable[[Goal], bool]:
    """The hidden object is at `p_map` (2,) [m]; goals within `reach` metres show it."""
    return lambda goal: bool(distances(p_map, goal.p_map)[0] <= reach)
