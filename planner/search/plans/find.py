"""The answer of `find`: what the map knows of the wanted things, and a plan of looks."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.shares import percent
from planner.search.goals.search_goals import explain_none
from planner.search.goals.targets import resolve, undetectable_target
from planner.search.plans.answer_sentences import find_sentences
from planner.search.plans.report import (
    direction,
    nothing_line,
    plan_lines,
    step_purpose,
    worthwhile,
)
from planner.search.plans.search_state import PlanningState, build_search
from planner.search.plans.view_plan import SHOWN, Start, ViewPlan, ViewStep, plan_from
from planner.settings import WORTH


@dataclass(frozen=True, slots=True, eq=False)
class FindAnswer:
    """The answer of `find`; printed, it is sentences and the first looks."""

    lines: tuple[str, ...]  # what the map knows of each wanted thing
    plan: ViewPlan | None  # where to look; None for a map without floor, and for nothing to see
    undetectable: tuple[str, ...] = ()  # wanted texts of things that no detector sees

    def __str__(self) -> str:
        if self.plan is None or not self.plan.steps:
            return "\n".join(self.lines)
        steps = self.plan.steps
        looks = min(worthwhile(steps), SHOWN)
        said = enumerate(map(_look, steps[:looks]), start=1)
        numbered = [f"{number}. {look}" for number, look in said]
        return "\n".join([*self.lines, *numbered, *plan_lines(self.plan, looks)])


def _look(step: ViewStep) -> str:
    x, y = (float(value) for value in step.p_map)
    return (
        f"From ({x:.1f}, {y:.1f}) in {step.place_name or 'no place'}, look {direction(step)}: "
        f"{step_purpose(step)} ({percent(step.probability)}, after {step.seconds:.0f} s)"
    )


def find(
    semantic_map: SemanticMap,
    *wanted: str,
    start: Sequence[float] | None = None,
    now: float | None = None,
    budget: float | None = None,
    worth: float = WORTH,
) -> FindAnswer:
    """A plan for what is wanted: where to look, in which order, why, and how long it takes.

    Args:
        semantic_map: The map.
        wanted: Names, categories, words or needs: ``cup``, ``cup 3``, ``something to sit on``.
        start: x, y [m] of the robot in the map and, if known, its heading [rad]; by default where
            the map has it.
        now: Time of the search [s since 1970]; by default the clock's.
        budget: Time after which the plan ends [s].
        worth: Least probability of a look that is worth its time, 0..1.

    Raises:
        UnknownCategoryError: a word is neither a category nor a need.
        QueryParameterError: nothing is wanted, or `start` or `now` has no such values.
    """
    if isinstance(semantic_map, PlanningState):
        raise TypeError("find takes a map and words; plan_views(state, start) plans for a state")
    if not wanted or not all(wanted):
        raise QueryParameterError("find needs what to look for, as in find(semantic_map, 'cup')")
    now = time.time() if now is None else now
    pose = None if start is None else _pose(start)
    if not math.isfinite(now):
        raise QueryParameterError(f"now is a time in seconds since 1970, got {now}")
    unseen = {text: undetectable_target(semantic_map, text) for text in wanted}
    lines = [f"{answer.answer}." for answer in unseen.values() if answer is not None]
    undetectable = tuple(text for text, answer in unseen.items() if answer is not None)
    words = [text for text in wanted if text not in undetectable]
    state = build_search(semantic_map, words, at=now, start=pose and pose[:2]) if words else None
    if state is None:
        kinds = [iri for target in resolve(semantic_map, words) for iri in target.queried]
        lines += [explain_none(semantic_map, iri) for iri in kinds]
        return FindAnswer(tuple(lines), None, undetectable)
    plan = plan_from(state, pose, budget=budget, worth=worth)
    for target in state.targets:
        lines += [target.note] if target.note else []
        lines += find_sentences(semantic_map, target, now, state, plan)
    lines += [] if plan.steps else [nothing_line(plan, budget)]
    return FindAnswer(tuple(lines), plan, undetectable)


def _pose(start: Sequence[float]) -> Start:
    try:
        x, y, heading = map(float, start) if len(start) == 3 else (*map(float, start), 0.0)
    except (TypeError, ValueError):
        x = y = heading = math.nan
    if not all(map(math.isfinite, (x, y, heading))):
        raise QueryParameterError(f"start is x, y [m] and perhaps a heading [rad], got {start}")
    return x, y, heading
