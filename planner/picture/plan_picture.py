"""A plan of looks drawn over its map: the way, the stops, and what of the floor each look shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.errors import LayoutError
from kg.semantic_map import SemanticMap
from planner.finding.hunt import Hunt
from planner.finding.plan import FindPlan, FindStep
from planner.goals import Goal
from planner.picture.drawing import Shade
from planner.picture.map_picture import plot_map
from planner.space.geodesic import way
from planner.space.sight import visible
from planner.viewing.sensor import angle_between

_SEEN: Final = "#f08c00"
_DARKEST: Final = 0.5
_SAME: Final = 0.2  # [m] looks from nearer to each other share a disc
_SHOWN: Final = 0.9  # share of what the plan finds whose looks are drawn; the rest would hide it


def plot_plan(semantic_map: SemanticMap, hunt: Hunt, plan: FindPlan, path: Path | str) -> Path:
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
        route=_route(hunt, plan, steps) if steps else None,
        goals=stops,
        numbers=numbers,
        shades=[_shade(hunt, steps)] if steps else [],
        title=f"{semantic_map.title}: where to look for {what}",
    )


def shown_steps(plan: FindPlan) -> tuple[FindStep, ...]:
    """The steps that are drawn."""
    found = np.cumsum([step.probability for step in plan.steps])
    count = int(np.searchsorted(found, _SHOWN * plan.probability - 1e-12)) + 1
    return plan.steps[:count]


def numbered_stops(looks: Sequence[NDArray[np.float64]]) -> tuple[list[Goal], list[str]]:
    """Positions ((2,) [m]) of `looks`, each once, with the numbers of the looks from there."""
    at: dict[tuple[float, float], list[int]] = {}
    for number, p_map in enumerate(looks, start=1):
        near = (xy for xy in at if np.hypot(xy[0] - p_map[0], xy[1] - p_map[1]) < _SAME)
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


def _route(hunt: Hunt, plan: FindPlan, steps: tuple[FindStep, ...]) -> NDArray[np.float64]:
    """(n, 2) [m] the way from stop to stop over the floor."""
    looks, cell = hunt.looks, hunt.space.nearest(plan.start)
    points = [plan.start[None, :]]
    for step in steps:
        stand = int(looks.stand[step.look])
        try:
            cells = way(hunt.space, looks.fields[stand], cell)
        except LayoutError:  # through a passage that no cell leads into
            cells = np.array([cell, looks.stands[stand]], np.intp)
        points.append(_smooth(hunt.space.centres(cells)))
        cell = int(looks.stands[stand])
    return np.concatenate(points)


def _smooth(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) each point the mean of its neighbours within two, the ends kept."""
    if len(points) < 5:
        return points
    padded = np.vstack([points[:1], points[:1], points, points[-1:], points[-1:]])
    mean = np.mean([padded[i : i + len(points)] for i in range(5)], axis=0)
    mean[0], mean[-1] = points[0], points[-1]
    return np.asarray(mean, np.float64)


def _shade(hunt: Hunt, steps: tuple[FindStep, ...]) -> Shade:
    """What the looks show, the more the likelier it is to be seen."""
    space, sensor = hunt.space, hunt.looks.sensor
    missed = np.ones(space.room.size)
    for step in steps:
        stand = int(hunt.looks.stands[hunt.looks.stand[step.look]])
        cells, offset = visible(space, stand, sensor.far)
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        inside = angle_between(bearing, step.heading) <= step.extent / 2 + 1e-9
        chance = np.where(inside, sensor.chance(np.hypot(offset[:, 0], offset[:, 1])), 0.0)
        missed[cells] *= 1.0 - chance
    strength = _DARKEST * (1.0 - missed).reshape(space.shape)
    return Shade("seen by the looks", _SEEN, strength, space.origin, space.cell)
