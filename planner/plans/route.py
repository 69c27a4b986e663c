"""The way of a plan over the floor, from stop to stop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kg.errors import LayoutError
from planner.freespace.geodesic import shortest_path
from planner.plans.search_state import PlanningState
from planner.plans.view_plan import ViewPlan, ViewStep


def planned_ways(
    state: PlanningState, plan: ViewPlan, steps: Sequence[ViewStep]
) -> list[NDArray[np.float64]]:
    """The way (n, 2) [m] to the stop of each of `steps`, the first ones of `plan`."""
    views, cell = state.views, state.space.nearest(plan.start)
    ways = []
    for step in steps:
        viewpoint = int(views.viewpoint[step.view])
        try:
            cells = shortest_path(state.space, views.fields[viewpoint], cell)
        except LayoutError:  # through a passage that no cell leads into
            cells = np.array([cell, views.viewpoints[viewpoint]], np.intp)
        ways.append(_smooth(state.space.centres(cells)))
        cell = int(views.viewpoints[viewpoint])
    return ways


def planned_route(
    state: PlanningState, plan: ViewPlan, steps: Sequence[ViewStep]
) -> NDArray[np.float64]:
    """(n, 2) [m] the whole way from the start over the stops of `steps`."""
    return np.concatenate([plan.start[None, :], *planned_ways(state, plan, steps)])


def _smooth(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) each point the mean of its neighbours within two, the ends kept."""
    if len(points) < 5:
        return points
    padded = np.vstack([points[:1], points[:1], points, points[-1:], points[-1:]])
    mean = np.mean([padded[i : i + len(points)] for i in range(5)], axis=0)
    mean[0], mean[-1] = points[0], points[-1]
    return np.asarray(mean, np.float64)
