"""The search that `hereabouts find` plans, as a part of a scene."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kg.maps.semantic_map import SemanticMap
from planner.display.plots.search_plot import SAME, shown_steps
from planner.display.viewers.scene import ScenePlan, SceneStop
from planner.execution.protocol import cleaned
from planner.search.plans.report import step_purpose
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import Start, ViewStep, plan_from, planned_route


def planned_search(
    semantic_map: SemanticMap, target: str, start: Start | None = None
) -> ScenePlan | None:
    """The first looks for `target`, which together have nine tenths of the plan's success.

    The plan begins at `start`, or at the robot's pose. None without a floor to search.
    Raises UnknownCategoryError for an unknown target.
    """
    state = build_search(semantic_map, [target])
    if state is None:
        return None
    found = plan_from(semantic_map, state, start, compare=False)
    steps = shown_steps(found)
    path = planned_route(state, found, steps) if steps else np.empty((0, 2))
    return ScenePlan(tuple((float(x), float(y)) for x, y in path), _stops(steps))


def _stops(steps: Sequence[ViewStep]) -> tuple[SceneStop, ...]:
    """A stop for each look; looks from one spot have their reasons at the first stop."""
    spots: list[tuple[float, float]] = []
    reasons: list[list[str]] = []
    for number, step in enumerate(steps, start=1):
        at = float(step.p_map[0]), float(step.p_map[1])
        first = next((i for i, spot in enumerate(spots) if math.dist(spot, at) < SAME), len(spots))
        what = step_purpose(step) or step.place_name
        reason = cleaned(f"{number}. {what}: {step.probability:.2f}, by {step.seconds:.0f} s")
        spots.append(at)
        reasons.append([])
        reasons[first].append(reason)
    return tuple(
        SceneStop(spot, step.heading, "\n".join(lines))
        for spot, step, lines in zip(spots, steps, reasons, strict=True)
    )
