"""Search plans and searches drawn over their map: path, stops, and the floor that looks show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hereabouts.display.plots.drawing import SHOWN_EXISTENCE, GroundTruth, Shade, Stop
from hereabouts.display.plots.label_placement import drawable
from hereabouts.display.plots.layout import Listing, ListItem
from hereabouts.display.plots.map_plot import Legend, SearchDrawing, plot_map
from kg.maps.semantic_map import SemanticMap
from kg.model.shares import percent
from planner.freespace.grid import visible_cells
from planner.search.plans.report import direction, fact_chain, plan_lines, step_purpose
from planner.search.plans.search_state import PlanningState
from planner.search.plans.view_plan import ViewPlan, ViewStep, planned_route
from planner.search.viewpoints.candidate_views import angle_between

_SEEN: Final = "#f08c00"
_MAX_SHADE: Final = 0.32
_LISTED: Final = 12  # looks that are put in words
_REASON: Final = 160  # letters of a reason
SAME: Final = 0.2  # [m] maximum distance of looks that share a disc or a text
_SHOWN: Final = 0.9  # share of the plan's success whose looks are drawn; more would hide the map


def plot_plan(
    semantic_map: SemanticMap,
    state: PlanningState,
    plan: ViewPlan,
    path: Path | str,
    *,
    least: float = SHOWN_EXISTENCE,
    legend: Legend = "class",
) -> Path:
    """Draw `plan` over the map to `path` and return it; PNG, SVG or PDF by its ending.

    The drawing has the first looks that together have nine tenths of the plan's success, and the
    first dozen of them in words; `least` and `legend` are those of `plot_map`.
    Raises PictureError like `plot_map`.
    """
    what = " and ".join(plan.targets)
    return plot_map(
        semantic_map,
        path,
        search=drawn_plan(state, plan),
        title=f"{semantic_map.description.title}: where to look for {what}",
        least=least,
        legend=legend,
    )


def plot_search(
    semantic_map: SemanticMap,
    search: str,
    path: Path | str,
    *,
    driven: ArrayLike,
    title: str,
    truth: GroundTruth | None = None,
) -> Path:
    """Draw the `search` (IRI) over the map to `path` and return it; PNG, SVG or PDF by its ending.

    `driven` (n, 2) [m] are positions of the robot; `truth` is that of `plot_map`. Raises
    PictureError like `plot_map`.
    """
    found = {
        iri
        for record in semantic_map.searches.all()
        if record.iri == search
        for iri in record.found
    }
    stops = numbered_stops(
        [np.array(look.position) for look in semantic_map.searches.looks(search)]
    )
    finds = [record.p_map for record in semantic_map.objects() if record.iri in found]
    line = np.asarray(driven, np.float64).reshape(-1, 2)
    return plot_map(
        semantic_map,
        path,
        search=SearchDrawing(line, stops, finds=tuple(finds)),
        title=title,
        truth=truth,
    )


def drawn_plan(state: PlanningState, plan: ViewPlan) -> SearchDrawing | None:
    """The first looks of `plan`; None without looks."""
    steps = shown_steps(plan)
    if not steps:
        return None
    return SearchDrawing(
        planned_route(state, plan, steps),
        numbered_stops(
            [step.p_map for step in steps], [(step.heading, step.extent) for step in steps]
        ),
        _shade(state, steps),
        listing=_listing(plan, steps),
    )


def _listing(plan: ViewPlan, steps: Sequence[ViewStep]) -> Listing:
    """Each look with its probability, its time, and its main reason if that is new."""
    items, given = [], set()
    for number, step in enumerate(steps[:_LISTED], start=1):
        why = step.why[0].candidate if step.why else None
        what = step_purpose(step)
        head = f"look {direction(step)}" + (f" for {what}" if what else "")
        reason = fact_chain(why.facts) if why is not None and why.iri not in given else ""
        given |= {why.iri} if why is not None else set()
        chance = f"finds it with {percent(step.probability)} after {step.seconds:.0f} s"
        items.append(
            ListItem(str(number), f"{drawable(head)}, {chance}", drawable(reason, _REASON))
        )
    rest = len(plan.steps) - len(items)
    more = f"; {rest} more look{'s follow' if rest > 1 else ' follows'}" if rest else ""
    return Listing(drawable(plan_lines(plan)[0], _REASON) + more, tuple(items))


def shown_steps(plan: ViewPlan) -> tuple[ViewStep, ...]:
    """The steps that are drawn."""
    found = np.cumsum([step.finds for step in plan.steps])
    count = int(np.searchsorted(found, _SHOWN * plan.finds - 1e-12)) + 1
    return plan.steps[:count]


def numbered_stops(
    views: Sequence[NDArray[np.float64]], looks: Sequence[tuple[float, float]] = ()
) -> tuple[Stop, ...]:
    """Positions ((2,) [m]) of `views`, each once, with the numbers of the looks from there.

    `looks` are heading and extent [rad] of each view, if they are to be drawn.
    """
    at: dict[tuple[float, float], list[int]] = {}
    for number, p_map in enumerate(views):
        near = (xy for xy in at if np.hypot(xy[0] - p_map[0], xy[1] - p_map[1]) < SAME)
        at.setdefault(next(near, (float(p_map[0]), float(p_map[1]))), []).append(number)
    return tuple(
        Stop(np.array(xy), _span([n + 1 for n in held]), tuple(looks[n] for n in held if looks))
        for xy, held in at.items()
    )


def _span(numbers: list[int]) -> str:
    """``3``, ``3-5`` or ``3,7``; for more numbers, the first and dots."""
    if len(numbers) == 1:
        return str(numbers[0])
    if numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}-{numbers[-1]}"
    return ",".join(map(str, numbers)) if len(numbers) == 2 else f"{numbers[0]}, ..."


def _shade(state: PlanningState, steps: tuple[ViewStep, ...]) -> Shade:
    """The floor that the looks show, darker where an object is more likely to be seen."""
    space, sensor = state.space, state.views.sensor
    missed = np.ones(space.room.size)
    for step in steps:
        viewpoint = int(state.views.viewpoints[state.views.viewpoint[step.view]])
        cells, offset = visible_cells(space, viewpoint, sensor.far)
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        inside = angle_between(bearing, step.heading) <= step.extent / 2 + 1e-9
        chance = np.where(inside, sensor.chance(np.hypot(offset[:, 0], offset[:, 1])), 0.0)
        missed[cells] *= 1.0 - chance
    strength = _MAX_SHADE * (1.0 - missed).reshape(space.shape)
    return Shade("seen by the looks", _SEEN, strength, space.origin, space.cell)
