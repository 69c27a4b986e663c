"""Table 4.5 searched by a robot that stops when its camera shows the object.

The thesis' own world: straight lines, no walls, a turn in the middle of a place shows all of it.
`sighted` drives to middles as the thesis does; `from_viewpoints` also stops at the edge of a place,
where half a turn, or in a corner a quarter, has all of it in view: that a look shows as far as the
place goes is the thesis' assumption, and is kept here. A thing that is too near for the
camera is missed from there, and looked for in a second round, from the middles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import fsum
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from kg.model.records import PlaceRecord
from lab.ordering.problem import OrderingProblem
from lab.ordering.solver import solve
from planner.search.goals.search_goals import Goal
from planner.search.plans.thesis_rules import Travel, distances
from planner.search.viewpoints.candidate_views import Motion, Sensor, angle_between

Point = NDArray[np.float64]

SENSOR = Sensor(recall=1.0)
_STEP = 0.1  # [m] between the points of a leg that are looked from
_TURN_STEP = np.radians(1.0)  # [rad] between the headings of a sweep that are looked in
_A_SIDE = 5  # viewpoints along a side of a place
_ROUNDS = 10  # most times that viewpoints and their order are chosen in turn


@dataclass(frozen=True, slots=True, eq=False)
class SightStop:
    """Where to look a place over: its middle, with a whole turn, or a viewpoint at its edge."""

    p_map: Point  # (2,) [m]
    ends: tuple[float, float] | None  # [rad] first and last heading of the sweep; None: whole turn

    def headings(self, arriving: float) -> NDArray[np.float64]:
        """[rad] of the camera in a sweep, from the one it arrives with on; nearer end first."""
        assert self.ends is not None, "a whole turn shows all, by the shorter way round"
        first, last = sorted(self.ends, key=lambda end: float(angle_between(end, arriving)))
        to_first = (first - arriving + np.pi) % (2 * np.pi) - np.pi
        count = [max(2, 1 + int(abs(turn) / _TURN_STEP)) for turn in (to_first, last - first)]
        begin = arriving + np.linspace(0.0, to_first, count[0])
        return np.concatenate([begin, begin[-1] + np.linspace(0.0, last - first, count[1])])

    def seconds(self, arriving: float) -> float:
        """[s] for all of the look."""
        if self.ends is None:
            return Travel().explore
        to_end = min(float(angle_between(end, arriving)) for end in self.ends)
        return (to_end + abs(self.ends[1] - self.ends[0])) / Motion().turn_rate


#: the goals in the order they are searched in, and where each is looked over from
Route = list[tuple[Goal, SightStop]]


def sighted(start: Point, order: Sequence[Goal], place: PlaceRecord, p_object: Point) -> float:
    """Seconds until the camera, forward on the way and round in a turn, first shows the object."""
    seconds, _, shown = _driven(start, middles(order), place, p_object)
    if not shown:
        raise AssertionError(f"{place.label} is among the goals of every search of the table")
    return seconds


def middles(goals: Sequence[Goal]) -> Route:
    """The thesis' way of searching: a whole turn in the middle of each."""
    return [(goal, SightStop(goal.p_map, None)) for goal in goals]


def _driven(
    start: Point, route: Route, place: PlaceRecord, p_object: Point
) -> tuple[float, Point, bool]:
    """[s] until the camera shows the object, where the robot then is, and whether it ever did."""
    speed, here, seconds = Travel().speed, start, 0.0
    for goal, stop in route:
        leg = stop.p_map - here
        metres, heading = float(np.hypot(*leg)), float(np.arctan2(leg[1], leg[0]))
        shown = _first_shown(here, leg, place, p_object)
        if shown is not None:
            return seconds + shown / speed, here, True
        seconds, here = seconds + metres / speed, stop.p_map
        if goal.iri == place.iri:
            turned = _turned_until_shown(stop, heading, p_object)
            if turned is not None:
                return seconds + turned / Motion().turn_rate, here, True
        seconds += stop.seconds(heading)
    return seconds, here, False


def order_for_sight(
    start: Point, goals: Sequence[Goal], places: Sequence[PlaceRecord]
) -> list[Goal]:
    """The order that expects least when it stops on sight, of all orders; ties as `permutations`.

    In every place the object may be anywhere, on 5 x 5 positions.
    """
    of = {place.iri: place for place in places}
    spots = {goal.iri: _spots(of[goal.iri]) for goal in goals}

    def expected(order: Iterable[Goal]) -> float:
        one = tuple(order)
        return fsum(
            goal.probability * fmean(sighted(start, one, of[goal.iri], p) for p in spots[goal.iri])
            for goal in one
        )

    return list(min(permutations(goals), key=expected))


def _spots(place: PlaceRecord) -> list[Point]:
    share = (np.arange(5) + 0.5) / 5
    low, high = np.array([place.xmin, place.ymin]), np.array([place.xmax, place.ymax])
    return [low + (high - low) * [x, y] for x in share for y in share]


def from_viewpoints(
    start: Point,
    goals: Sequence[Goal],
    places: Mapping[str, PlaceRecord],
    place: PlaceRecord,
    p_object: Point,
) -> float:
    """Seconds until the camera shows the object, with viewpoints and their order for the goals."""
    seconds, here, shown = _driven(start, planned(start, goals, places), place, p_object)
    return seconds if shown else seconds + sighted(here, goals, place, p_object)


def planned(start: Point, goals: Sequence[Goal], places: Mapping[str, PlaceRecord]) -> Route:
    """Where to stop and in which order, for the least expected time to have looked the place over.

    Viewpoints are optimal for their order, the order for its viewpoints.
    """
    least, best = np.inf, middles(goals)
    ordered, _ = best_order(start, best)
    for _ in range(_ROUNDS):
        expected, route = _with_stops(start, ordered, places)
        if expected >= least - 1e-9:
            break
        least, best = expected, route
        ordered, _ = best_order(start, route)
    return best


def best_order(start: Point, route: Route) -> tuple[list[Goal], bool]:
    """The goals in the order that is best for these stops, and whether that is proven."""
    stops = [stop for _, stop in route]
    T = np.array([[_leg(a.p_map, b) if a is not b else 0.0 for b in stops] for a in stops])
    t0 = np.array([_leg(start, stop) for stop in stops])
    p = np.array([goal.probability for goal, _ in route])
    found = solve(OrderingProblem(p, T, t0, np.zeros(len(stops))))
    return [route[i][0] for i in found.order], found.proven


def _candidates(place: PlaceRecord) -> list[SightStop]:
    """The middle, and points of the edge."""
    x = np.linspace(place.xmin, place.xmax, _A_SIDE)
    y = np.linspace(place.ymin, place.ymax, _A_SIDE)
    edge = [np.array([px, py]) for px in x for py in y if px in x[[0, -1]] or py in y[[0, -1]]]
    corners = np.array([[px, py] for px in x[[0, -1]] for py in y[[0, -1]]])
    middle = np.array([x.mean(), y.mean()])
    stops = [SightStop(middle, None)]
    for point in edge:
        towards = float(np.arctan2(*(middle - point)[::-1]))
        away = corners[distances(point, corners) > 0] - point
        off = (np.arctan2(away[:, 1], away[:, 0]) - towards + np.pi) % (2 * np.pi) - np.pi
        half = SENSOR.field_of_view / 2
        low, high = off.min() + half, off.max() - half
        ends = (towards + low, towards + high) if low < high else (towards, towards)
        stops.append(SightStop(point, ends))
    return stops


def _with_stops(
    start: Point, ordered: Sequence[Goal], places: Mapping[str, PlaceRecord]
) -> tuple[float, Route]:
    """The stops of least expected time for goals in this order; dynamic programming."""
    p = np.array([goal.probability for goal in ordered])
    left = p[::-1].cumsum()[::-1] / p.sum()
    ways: list[tuple[float, Route]] = [(0.0, [])]
    for share, goal in zip(left, ordered, strict=True):
        on = [(cost, way, way[-1][1].p_map if way else start) for cost, way in ways]
        ways = [
            min(
                ((cost + share * _leg(at, stop), [*way, (goal, stop)]) for cost, way, at in on),
                key=lambda one: one[0],
            )
            for stop in _candidates(places[goal.iri])
        ]
    return min(ways, key=lambda one: one[0])


def _leg(here: Point, stop: SightStop) -> float:
    """[s] to drive on to `stop` and look."""
    leg = stop.p_map - here
    return float(np.hypot(*leg)) / Travel().speed + stop.seconds(float(np.arctan2(*leg[::-1])))


def _first_shown(here: Point, leg: Point, place: PlaceRecord, p_object: Point) -> float | None:
    """[m] driven along `leg` until the camera, forward, shows the object; None: it never does."""
    metres = float(np.hypot(*leg))
    points = here + leg * np.linspace(0.0, 1.0, max(2, round(metres / _STEP)))[:, None]
    heading = float(np.arctan2(leg[1], leg[0]))
    shown = np.flatnonzero(in_view(points, heading, place, p_object))
    return float(np.hypot(*(points[shown[0]] - here))) if len(shown) else None


def _turned_until_shown(stop: SightStop, arriving: float, p_object: Point) -> float | None:
    """[rad] turned until the object is in view; None where it is nearer than the camera sees."""
    offset = p_object - stop.p_map
    bearing = float(np.arctan2(offset[1], offset[0]))
    if stop.ends is None:  # the thesis' turn: shows all, by the shorter way round
        return max(float(angle_between(bearing, arriving)) - SENSOR.field_of_view / 2, 0.0)
    if np.hypot(*offset) < SENSOR.near:
        return None
    headings = stop.headings(arriving)
    seen = np.flatnonzero(angle_between(bearing, headings) <= SENSOR.field_of_view / 2 + 1e-6)
    turned = np.append(0.0, np.abs(np.diff(headings)).cumsum())
    return float(turned[seen[0]]) if len(seen) else None


def in_view(
    points: NDArray[np.float64],
    heading: float,
    place: PlaceRecord,
    p_object: Point,
) -> NDArray[np.bool_]:
    """(n,) from which points (n, 2), all in the object's place, the camera shows it."""
    offset = p_object - points
    metres = np.hypot(offset[:, 0], offset[:, 1])
    ahead = angle_between(np.arctan2(offset[:, 1], offset[:, 0]), heading)
    x, y = points.T
    inside = (x >= place.xmin) & (x <= place.xmax) & (y >= place.ymin) & (y <= place.ymax)
    near = (metres >= SENSOR.near) & (metres <= SENSOR.far)
    return np.asarray(inside & near & (ahead <= SENSOR.field_of_view / 2))
