"""No sequence of looks finds as much sooner than the bound says."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.freespace.floor_plan import free_space
from planner.freespace.grid import Room
from planner.plans.time_bound import seconds_times_found
from planner.viewpoints.candidate_views import CandidateViews, candidate_views
from planner.viewpoints.next_best_view import NextBestView, RobotState
from planner.viewpoints.revisits import RevisitModel
from planner.viewpoints.sensor import Motion, Sensor

SENSORS = (
    Sensor(far=3.0),
    Sensor(far=3.0, recall=1.0, rho=1.0),
    Sensor(far=4.0, near=0.0, recall=0.5, rho=0.0, field_of_view=2.0),
)
MOTIONS = (Motion(), Motion(speed=2.0, turn_rate=0.2, picture=0.0), Motion(0.1, 3.0, 5.0))


def some_looks(rng: np.random.Generator, sensor: Sensor, motion: Motion) -> CandidateViews:
    rooms = [Room(0, 4, 0, 3), Room(4, 7, 0, 3), Room(0, 7, 3, 5)]
    space = free_space(rooms, None)
    viewpoints = np.sort(rng.choice(space.floor(), 6, replace=False))
    return candidate_views(space, sensor, motion, cells=space.floor()[::7], viewpoints=viewpoints)


def some_instances(rng: np.random.Generator, cells: int, count: int) -> NDArray[np.float64]:
    weight = rng.random((count, cells)) ** 8
    return weight / weight.sum(axis=1, keepdims=True) * rng.uniform(0.2, 1.0, (count, 1))


def rollout(
    views: CandidateViews, at: RobotState, weight: NDArray[np.float64], order: tuple[int, ...]
) -> list[tuple[float, float]]:
    """(seconds, probability to have found any instance by then) after each look."""
    next_best_view, revisits = NextBestView(views), RevisitModel(views)
    unseen, seconds, found = np.ones(weight.shape[1]), 0.0, []
    for view in order:
        seconds += float(next_best_view.costs(at, np.array([view]))[0])
        unseen = unseen * (1 - revisits.chance(view).astype(np.float64))
        revisits.add(view)
        at = next_best_view.after(at, view)
        found.append((seconds, 1 - float(np.prod(1 - weight @ (1 - unseen)))))
    return found


@pytest.mark.parametrize(("sensor", "motion"), list(zip(SENSORS, MOTIONS, strict=True)))
@pytest.mark.parametrize("instances", [1, 5])
def test_no_sequence_of_looks_beats_the_bound(
    sensor: Sensor, motion: Motion, instances: int
) -> None:
    rng = np.random.default_rng(instances)
    views = some_looks(rng, sensor, motion)
    weight = some_instances(rng, len(views.cells), instances)
    at = RobotState(int(rng.choice(views.space.floor())), float(rng.uniform(-3, 3)))
    worth = views.chance @ weight.sum(axis=0)
    rate = worth / views.seconds.clip(0.1)
    least: dict[float, float] = {}  # found -> seconds times found, of the best sequence
    for chosen in ((rate, worth), (rate,), (rng.random(len(worth)),)):
        some = {int(view) for values in chosen for view in np.argsort(-values)[:2]}
        for order in (order for n in (1, 2, 3) for order in permutations(some, n)):
            known = [(0.0, 0.0), *rollout(views, at, weight, order)]
            time = sum(t * (p - q) for (t, p), (_, q) in zip(known[1:], known, strict=False))
            found = round(known[-1][1], 6)
            least[found] = min(time, least.get(found, np.inf))
    for found, time in least.items():
        assert seconds_times_found(views, at, weight, found - 1e-6) <= time + 1e-6


def test_a_robot_that_stands_where_it_looks_from_is_bounded_too() -> None:
    rng = np.random.default_rng(5)
    views = some_looks(rng, Sensor(), Motion())
    weight = some_instances(rng, len(views.cells), 1)
    viewpoint = int(views.viewpoint[np.argmax(views.chance @ weight[0])])
    at = RobotState(int(views.viewpoints[viewpoint]), 0.0, viewpoint)
    for view in np.flatnonzero(views.viewpoint == viewpoint):
        ((seconds, found),) = rollout(views, at, weight, (int(view),))
        assert seconds_times_found(views, at, weight, found) <= seconds * found + 1e-6


def test_what_is_farther_takes_longer() -> None:
    rng = np.random.default_rng(7)
    views = some_looks(rng, Sensor(), Motion())
    order = np.argsort(views.metres_from(int(views.viewpoints[0])))
    at = RobotState(int(views.viewpoints[0]))
    bounds = []
    for viewpoint in (order[0], order[-1]):
        shown = views.chance[views.viewpoint == viewpoint].max(axis=0) > 0
        only = shown & ~(views.chance[views.viewpoint != viewpoint] > 0).any(axis=0)
        if not only.any():
            only = shown
        weight = (only / only.sum())[None, :]
        bounds.append(seconds_times_found(views, at, weight, 0.5))
    assert bounds[0] < bounds[1]


def test_slower_robots_have_higher_bounds() -> None:
    rng = np.random.default_rng(11)
    views = some_looks(rng, Sensor(), Motion())
    weight = some_instances(rng, len(views.cells), 3)
    at = RobotState(int(views.viewpoints[0]))
    slower = replace(views, motion=replace(views.motion, speed=0.1))
    fast, slow = (seconds_times_found(one, at, weight, 0.5) for one in (views, slower))
    assert 0 < fast < slow
