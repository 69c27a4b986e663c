"""The thesis' Table 4.5 beside better ways of searching the same building for the same things.

    python -m benchmarks.search.table_4_5_homes [--json]

Two worlds. In the thesis' own the robot drives straight lines between the middles of places, and a
turn there shows all of the place. With real coverage there are walls, doors in the middle of common
walls, and a camera that sees 0.8 to 4.6 m; a place is then covered by as many turns as it takes.
Nothing is missed in either (recall 1). Where the printed pose of an object contradicts its place
(`lab/thesis/corrections.csv`) it lies in the middle of the place. Ratios are means over the
18 searches of brute force's time, in the same world, over that of the way named.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.homes import Home, HomeRoom
from benchmarks.search.room_beliefs import RoomChances
from benchmarks.search.room_policies import brute_force, oracle, thesis_rule
from benchmarks.search.stopping_on_sight import (
    SENSOR,
    best_order,
    from_viewpoints,
    middles,
    order_for_sight,
    sighted,
)
from benchmarks.search.view_policy import Ablation, ours
from kg.model.records import PlaceRecord
from lab.thesis.table_4_5 import TableRow, reference_world, table_4_5
from planner.freespace.grid import Room
from planner.search.goals.search_goals import Goal, derive_goals
from planner.search.plans.thesis_rules import Travel, distances, nearest_first
from planner.search.viewpoints.candidate_views import Motion


@dataclass(frozen=True, slots=True)
class HomesRow:
    """Seconds by way of searching, of one of the 18 searches."""

    target: str
    proven: bool  # the order of the goals is optimal
    seconds: dict[str, float]


def main() -> None:
    """Print the table as Markdown, or JSON."""
    found = list(lines())
    means = {way: fmean(line.seconds[way] for line in found) for way in found[0].seconds}
    ratios = {way: _ratio(found, way) for way in means}
    if "--json" in sys.argv:
        rows = [{"object": one.target, "proven": one.proven, **one.seconds} for one in found]
        sys.stdout.write(json.dumps({"rows": rows, "means": means, "ratios": ratios}, indent=1))
        return
    text = ["| way | world | mean t [s] | mean t_b / t |", "|---|---|---|---|"]
    for way, mean in means.items():
        world, _, name = way.partition(": ")
        text.append(f"| {name} | {world} | {mean:.1f} | {ratios[way]:.2f} |")
    text.append(f"\n{sum(line.proven for line in found)} of {len(found)} orders proven optimal")
    sys.stdout.write("\n".join(text) + "\n")


def _ratio(found: Sequence[HomesRow], way: str) -> float:
    brute = f"{way.partition(': ')[0]}: brute force"
    return fmean(line.seconds[brute] / line.seconds[way] for line in found)


def lines() -> Iterator[HomesRow]:
    """All 18 searches."""
    with reference_world() as world:
        places = sorted(world.places(), key=lambda place: int(place.label.split()[1]))
        building = _building(places)
        for row in table_4_5():
            goals = derive_goals(world, row.scenario.target)
            yield _line(row, goals, places, building)


def _line(
    row: TableRow, goals: Sequence[Goal], places: Sequence[PlaceRecord], building: HomeSpace
) -> HomesRow:
    start = row.scenario.start
    place = places[row.scenario.object_place]
    p_object = _pose(row, place)
    order, proven = best_order(start, middles(goals))
    nearest = [step.goal for step in nearest_first(start, goals).steps]
    said = row.scenario.published
    seconds = {
        "printed: brute force": said.t_b,
        "printed: thesis' rule": said.t_r,
        "thesis: brute force": row.brute.seconds,
        "thesis: thesis' rule, again": row.ontology.seconds,
        "thesis: best order": _turning(start, order, place),
        "thesis: thesis' rule, stopping on sight": sighted(start, nearest, place, p_object),
        "thesis: best order, stopping on sight": sighted(start, order, place, p_object),
        "thesis: order for sight, stopping on sight": sighted(
            start, order_for_sight(start, goals, places), place, p_object
        ),
        "thesis: viewpoints, stopping on sight": from_viewpoints(
            start, goals, {p.iri: p for p in places}, place, p_object
        ),
        "thesis: clairvoyant, one turn": _turning(start, [_goal_at(place)], place),
    }
    seconds |= _covered(building, start, row.scenario.object_place, p_object, goals, places)
    return HomesRow(row.scenario.target, proven, seconds)


def _pose(row: TableRow, place: PlaceRecord) -> NDArray[np.float64]:
    x, y = row.scenario.printed_object
    inside = place.xmin <= x <= place.xmax and place.ymin <= y <= place.ymax
    return row.scenario.printed_object if inside else _middle(place)


def _middle(place: PlaceRecord) -> NDArray[np.float64]:
    return np.array([place.xmin + place.xmax, place.ymin + place.ymax]) / 2


def _goal_at(place: PlaceRecord) -> Goal:
    return Goal(place.iri, "place", place.label, _middle(place), 1.0, "it is there")


def _turning(start: NDArray[np.float64], order: Sequence[Goal], place: PlaceRecord) -> float:
    """Seconds until the turn in `place` is over."""
    travel, here, seconds = Travel(), start, 0.0
    for goal in order:
        seconds += float(distances(here, goal.p_map)[0]) / travel.speed + travel.explore
        here = goal.p_map
        if goal.iri == place.iri:
            return seconds
    raise AssertionError(f"{place.label} is among the goals of every search of the table")


def _building(places: Sequence[PlaceRecord]) -> HomeSpace:
    rooms = tuple(
        HomeRoom(place.label, Room(place.xmin, place.xmax, place.ymin, place.ymax), {})
        for place in places
    )
    return HomeSpace(Home("Fig. 4.7", rooms, None), SENSOR, Motion())


def _covered(
    building: HomeSpace,
    start: NDArray[np.float64],
    room: int,
    p_object: NDArray[np.float64],
    goals: Sequence[Goal],
    places: Sequence[PlaceRecord],
) -> dict[str, float]:
    space = building.space
    begin = space.nearest(start)
    hidden = HiddenObject(space, SENSOR, [space.nearest(p_object, room)], "Table 4.5")
    chances = {goal.iri: goal.probability for goal in goals}
    p = np.array([chances.get(place.iri, 0.0) for place in places])
    rooms = RoomChances.apart(p)
    outcomes = {
        "brute force": brute_force(building, begin, hidden),
        "thesis' rule": thesis_rule(building, begin, hidden, (p > 0).tolist()),
        "ours, whole turns": ours(
            building, begin, hidden, rooms, Ablation(apart=math.inf, whole_turns=True)
        ),
        "ours, viewpoints": ours(building, begin, hidden, rooms, Ablation(apart=math.inf)),
        "ours, viewpoints and on the way": ours(building, begin, hidden, rooms),
        "clairvoyant": oracle(building, begin, hidden),
    }
    assert all(outcome.found for outcome in outcomes.values()), outcomes
    return {f"real coverage: {name}": outcome.seconds for name, outcome in outcomes.items()}


if __name__ == "__main__":
    main()
