"""The demo's search: planned for the simulated robot and carried out by it; its events in short."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
from kg.model.shares import percent
from planner.execution.options import Event, SearchOptions, SearchOutcome
from planner.execution.search_loop import search
from planner.execution.viewpoint_adapter import motion_of, sensor_of
from planner.search.plans.report import fact_chain, without_sources
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import ViewPlan, plan
from planner.simulation.house_robot import SimulatedHouseRobot

_LITTLE = 0.01  # chance of a look below which its events are not told


@dataclass(frozen=True, slots=True, eq=False)
class DemoPlan:
    """The plan before the robot drives."""

    plan: ViewPlan
    options: str  # of `hereabouts find` for this robot


@dataclass(frozen=True, slots=True, eq=False)
class DrivenSearch:
    """The outcome of the search."""

    outcome: SearchOutcome
    events: tuple[Event, ...]
    driven: NDArray[np.float64]  # (n, 2) [m] positions of the robot
    p_found: NDArray[np.float64] | None  # (3,) [m] position of the found target in the map

    @property
    def found(self) -> bool:
        """Whether the target was found."""
        return self.outcome.state == "found"

    @property
    def distance(self) -> float:
        """[m] driven."""
        return float(np.linalg.norm(np.diff(self.driven, axis=0), axis=1).sum())

    @property
    def in_vain(self) -> int:
        """Number of views that did not show the target."""
        return sum(event.kind == "look" and not event.data["found"] for event in self.events)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "found": self.found,
            "looks": self.outcome.looks,
            "explored_in_vain": self.in_vain,
            "seconds": round(self.outcome.seconds, 1),
            "distance": round(self.distance, 2),
            "events": [event.to_json() for event in self.events],
        }


def plan_for(semantic_map: SemanticMap, target: str, robot: SimulatedHouseRobot) -> DemoPlan:
    """The plan of `hereabouts find` for `target`, from the pose of `robot` in the map.

    Raises LayoutError where the map has no robot or no floor.
    """
    hello, here = robot.hello, semantic_map.robot()
    sensor, motion = sensor_of(hello), motion_of(hello)
    state = build_search(semantic_map, [target], sensor=sensor, motion=motion)
    if here is None or state is None:
        raise LayoutError("the map has neither a robot nor places: nothing was mapped into it")
    start = here.p_map[:2]
    found = plan(state, start, heading=here.heading, time_limit=math.inf)
    return DemoPlan(
        plan=found,
        options=f"--speed {motion.speed:g} --turn-rate {math.degrees(motion.turn_rate):.1f} "
        f"--range {sensor.near:g},{sensor.far:g} --recall {sensor.recall:g} --now map",
    )


def carry_out(
    semantic_map: SemanticMap,
    target: str,
    robot: SimulatedHouseRobot,
    on_event: Callable[[Event], None],
) -> DrivenSearch:
    """Search for `target` with `robot`; views and finds are written with the house's time."""
    events = list[Event]()
    here = semantic_map.robot()
    began = 0.0 if here is None else here.stamp

    def receive(event: Event) -> None:
        events.append(event)
        on_event(event)

    options = SearchOptions(on_event=receive, clock=lambda: began + robot.seconds)
    outcome = search(semantic_map, [target], robot, options)
    positions = {o.iri: o.p_map for o in semantic_map.objects()}
    p_found = next((positions[iri] for iri in outcome.found if iri in positions), None)
    return DrivenSearch(outcome, tuple(events), robot.driven, p_found)


def in_short(events: Iterable[Event]) -> Iterator[tuple[float, str]]:
    """Seconds and lines of events; a plan has its weightiest reason, without sources, once.

    Looks in vain that promised less than `_LITTLE` are left out.
    """
    before, held = "", list[tuple[float, str]]()
    for event in events:
        at, line = float(event.data["seconds"]), event.text
        if event.kind == "plan" and event.data["why"]:
            reason, data = without_sources(event.data["why"][0]).partition(": ")[2], event.data
            why = f": {fact_chain(reason.split('; '))}" if reason != before else ""
            before, where = reason, f"{data['place']} ({data['x']:.1f}, {data['y']:.1f})"
            line = f"to {where}, finds it with {percent(data['probability'])}{why}"
        if event.kind == "plan" and event.data["probability"] < _LITTLE:
            held = [(at, line)]
        elif held and event.kind == "look" and not event.data["found"]:
            before, held = "", []
        else:
            yield from (*held, (at, line))
            held = []
