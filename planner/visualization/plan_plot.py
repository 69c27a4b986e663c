"""A plan of looks drawn over its map: the way, the stops, and what of the floor each look shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from planner.freespace.line_of_sight import visible_cells
from planner.goals.search_goals import Goal
from planner.plans.route import planned_route
from planner.plans.search_state import PlanningState
from planner.plans.view_plan import ViewPlan, ViewStep
from planner.viewpoints.sensor import angle_between
from planner.visualization.drawing import Shade
from planner.visualization.map_plot import plot_map

_SEEN: Final = "#f08c00"
_DARKEST: Final = 0.5
SAME: Final = 0.2  # [m] looks from nearer to each other share a disc or a text
_SHOWN: Final = 0.9  # share of what the plan finds whose looks are drawn; the rest would hide it


def plot_plan(
    semantic_map: SemanticMap, state: PlanningState, plan: ViewPlan, path: Path | str
) -> Path:
    """Draw `plan` over the map to `path` and return it; PNG, SVG or PDF by its ending.

    Drawn are the first looks, until nine tenths of what the plan finds are found. Raises
    PictureError as `plot_map` does.
    """
    steps = shown_steps(plan)
    stops, numbers = numbered_stops([step.p_map for step in steps])
    what = " and ".join(plan.targets)
    return plot_map(
        semantic_map,
        path,
        route=planned_route(state, plan, steps) if steps else None,
        goals=stops,
        numbers=numbers,
        shades=[_shade(state, steps)] if steps else [],
        title=f"{semantic_map.title}: where to look for {what}",
    )


def shown_steps(plan: ViewPlan) -> tuple[ViewStep, ...]:
    """The steps that are drawn."""
    found = np.cumsum([step.probability for step in plan.steps])
    count = int(np.searchsorted(found, _SHOWN * plan.probability - 1e-12)) + 1
    return plan.steps[:count]


def numbered_stops(views: Sequence[NDArray[np.float64]]) -> tuple[list[Goal], list[str]]:
    """Positions ((2,) [m]) of `views`, each once, with the numbers of the looks from there."""
    at: dict[tuple[float, float], list[int]] = {}
    for number, p_map in enumerate(views, start=1):
        near = (xy for xy in at if np.hypot(xy[0] - p_map[0], xy[1] - p_map[1]) < SAME)
        at.setdefault(next(near, (float(p_map[0]), float(p_map[1]))), []).append(number)
    goals = [Goal("", "place", "", np.array(xy), 1.0, "") for xy in at]
    return goals, [_span(numbers) for numbers in at.values()]


def _span(numbers: list[int]) -> str:
    """``3``, ``3-5`` or ``3,7``; of more than fit, the first and dots."""
    if len(numbers) == 1:
        return str(numbers[0])
    if numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}-{numbers[-1]}"
    return ",".join(map(str, numbers)) if len(numbers) == 2 else f"{numbers[0]}, ..."


def _shade(state: PlanningState, steps: tuple[ViewStep, ...]) -> Shade:
    """What the looks show, the more the likelier it is to be seen."""
    space, sensor = state.space, state.views.sensor
    missed = np.ones(space.room.size)
    for step in steps:
        viewpoint = int(state.views.viewpoints[state.views.viewpoint[step.view]])
        cells, offset = visible_cells(space, viewpoint, sensor.far)
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        inside = angle_between(bearing, step.heading) <= step.extent / 2 + 1e-9
        chance = np.where(inside, sensor.chance(np.hypot(offset[:, 0], offset[:, 1])), 0.0)
        missed[cells] *= 1.0 - chance
    strength = _DARKEST * (1.0 - missed).reshape(space.shape)
    return Shade("seen by the looks", _SEEN, strength, space.origin, space.cell)
