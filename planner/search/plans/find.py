"""The answer of `find`: what the map knows of the wanted things, and a plan of looks."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError
from kg.model.shares import percent
from planner.search.goals.search_goals import explain_none
from planner.search.goals.targets import Target, resolve, undetectable_target
from planner.search.plans.answer_sentences import find_sentences
from planner.search.plans.report import (
    answer_json,
    direction,
    empty_answer,
    nothing_line,
    plan_lines,
    step_purpose,
    worthwhile,
)
from planner.search.plans.search_state import PlanningState, build_search
from planner.search.plans.view_plan import SHOWN, Start, ViewPlan, ViewStep, plan_from
from planner.settings import WORTH

if TYPE_CHECKING:
    from planner.freespace.grid import FreeSpace
    from planner.search.viewpoints.candidate_views import Motion, Sensor


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSearch:
    """A plan for words, and what it was made from."""

    semantic_map: SemanticMap
    targets: tuple[Target, ...]
    now: float  # [s] since 1970
    state: PlanningState | None  # None for a map without floor, and for nothing to see
    plan: ViewPlan | None

    def without_floor(self) -> list[str]:
        """Why a map without floor has nowhere to look for each kind of thing."""
        kinds = [iri for target in self.targets for iri in target.queried]
        return [explain_none(self.semantic_map, iri) for iri in kinds]

    def to_json(self) -> dict[str, object]:
        """The answer of `find --json`."""
        if self.state is None or self.plan is None:
            return empty_answer(self.semantic_map, self.targets, self.now)
        return answer_json(self.semantic_map, self.state, self.plan, self.now)


def plan_words(
    semantic_map: SemanticMap,
    words: Sequence[str],
    *,
    now: float | None = None,
    start: Start | None = None,
    budget: float | None = None,
    worth: float = WORTH,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    space: FreeSpace | None = None,
) -> PlannedSearch:
    """The plan for words that detectors can see; arguments are those of `find` and `build_search`.

    Raises UnknownCategoryError for a word that is neither a category nor a need.
    """
    now = time.time() if now is None else now
    at = None if start is None else start[:2]
    state = build_search(
        *(semantic_map, words), sensor=sensor, motion=motion, space=space, at=now, start=at
    )
    if state is None:
        return PlannedSearch(semantic_map, tuple(resolve(semantic_map, words)), now, None, None)
    plan = plan_from(state, start, budget=budget, worth=worth)
    return PlannedSearch(semantic_map, tuple(state.targets), now, state, plan)


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
    if not words:
        return FindAnswer(tuple(lines), None, undetectable)
    found = plan_words(semantic_map, words, now=now, start=pose, budget=budget, worth=worth)
    if found.plan is None:
        return FindAnswer((*lines, *found.without_floor()), None, undetectable)
    for target in found.targets:
        lines += [target.note] if target.note else []
        lines += find_sentences(semantic_map, target, now, found.state, found.plan)
    lines += [] if found.plan.steps else [nothing_line(found.plan, budget)]
    return FindAnswer(tuple(lines), found.plan, undetectable)


def _pose(start: Sequence[float]) -> Start:
    try:
        x, y, heading = map(float, start) if len(start) == 3 else (*map(float, start), 0.0)
    except (TypeError, ValueError):
        x = y = heading = math.nan
    if not all(map(math.isfinite, (x, y, heading))):
        raise QueryParameterError(f"start is x, y [m] and perhaps a heading [rad], got {start}")
    return x, y, heading
