"""No sequence of looks finds as much sooner than the bound says."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.finding.bound import seconds_times_found
from planner.space.building import free_space
from planner.space.grid import Room
from planner.viewing.looks import Looks, candidate_looks
from planner.viewing.memory import Memory
from planner.viewing.sensor import Motion, Sensor
from planner.viewing.tour import Standing, Tourist

SENSORS = (
    Sensor(far=3.0),
    Sensor(far=3.0, recall=1.0, rho=1.0),
    Sensor(far=4.0, near=0.0, recall=0.5, rho=0.0, field_of_view=2.0),
)
MOTIONS = (Motion(), Motion(speed=2.0, turn_rate=0.2, picture=0.0), Motion(0.1, 3.0, 5.0))


def some_looks(rng: np.random.Generator, sensor: Sensor, motion: Motion) -> Looks:
    rooms = [Room(0, 4, 0, 3), Room(4, 7, 0, 3), Room(0, 7, 3, 5)]
    space = free_space(rooms, None)
    stands = np.sort(rng.choice(space.floor(), 6, replace=False))
    return candidate_looks(space, sensor, motion, cells=space.floor()[::7], stands=stands)


def some_instances(rng: np.random.Generator, cells: int, count: int) -> NDArray[np.float64]:
    weight = rng.random((count, cells)) ** 8
    return weight / weight.sum(axis=1, keepdims=True) * rng.uniform(0.2, 1.0, (count, 1))


def played(
    looks: Looks, at: Standing, weight: NDArray[np.float64], order: tuple[int, ...]
) -> list[tuple[float, float]]:
    """(seconds, probability to have found any instance by then) after each look."""
    tourist, memory = Tourist(looks), Memory(looks)
    unseen, seconds, found = np.ones(weight.shape[1]), 0.0, []
    for look in order:
        seconds += float(tourist.costs(at, np.array([look]))[0])
        unseen = unseen * (1 - memory.chance(look).astype(np.float64))
        memory.note(look)
        at = tourist.after(at, look)
        found.append((seconds, 1 - float(np.prod(1 - weight @ (1 - unseen)))))
    return found


@pytest.mark.parametrize(("sensor", "motion"), list(zip(SENSORS, MOTIONS, strict=True)))
@pytest.mark.parametrize("instances", [1, 5])
def test_no_sequence_of_looks_beats_the_bound(
    sensor: Sensor, motion: Motion, instances: int
) -> None:
    rng = np.random.default_rng(instances)
    looks = some_looks(rng, sensor, motion)
    weight = some_instances(rng, len(looks.cells), instances)
    at = Standing(int(rng.choice(looks.space.floor())), float(rng.uniform(-3, 3)))
    worth = looks.chance @ weight.sum(axis=0)
    rate = worth / looks.seconds.clip(0.1)
    least: dict[float, float] = {}  # found -> seconds times found, of the best sequence
    for chosen in ((rate, worth), (rate,), (rng.random(len(worth)),)):
        some = {int(look) for values in chosen for look in np.argsort(-values)[:2]}
        for order in (order for n in (1, 2, 3) for order in permutations(some, n)):
            known = [(0.0, 0.0), *played(looks, at, weight, order)]
            time = sum(t * (p - q) for (t, p), (_, q) in zip(known[1:], known, strict=False))
            found = round(known[-1][1], 6)
            least[found] = min(time, least.get(found, np.inf))
    for found, time in least.items():
        assert seconds_times_found(looks, at, weight, found - 1e-6) <= time + 1e-6


def test_a_robot_that_stands_where_it_looks_from_is_bounded_too() -> None:
    rng = np.random.default_rng(5)
    looks = some_looks(rng, Sensor(), Motion())
    weight = some_instances(rng, len(looks.cells), 1)
    stand = int(looks.stand[np.argmax(looks.chance @ weight[0])])
    at = Standing(int(looks.stands[stand]), 0.0, stand)
    for look in np.flatnonzero(looks.stand == stand):
        ((seconds, found),) = played(looks, at, weight, (int(look),))
        assert seconds_times_found(looks, at, weight, found) <= seconds * found + 1e-6


def test_what_is_farther_takes_longer() -> None:
    rng = np.random.default_rng(7)
    looks = some_looks(rng, Sensor(), Motion())
    order = np.argsort(looks.metres_from(int(looks.stands[0])))
    at = Standing(int(looks.stands[0]))
    bounds = []
    for stand in (order[0], order[-1]):
        shown = looks.chance[looks.stand == stand].max(axis=0) > 0
        only = shown & ~(looks.chance[looks.stand != stand] > 0).any(axis=0)
        if not only.any():
            only = shown
        weight = (only / only.sum())[None, :]
        bounds.append(seconds_times_found(looks, at, weight, 0.5))
    assert bounds[0] < bounds[1]


def test_slower_robots_have_higher_bounds() -> None:
    rng = np.random.default_rng(11)
    looks = some_looks(rng, Sensor(), Motion())
    weight = some_instances(rng, len(looks.cells), 3)
    at = Standing(int(looks.stands[0]))
    slower = replace(looks, motion=replace(looks.motion, speed=0.1))
    fast, slow = (seconds_times_found(one, at, weight, 0.5) for one in (looks, slower))
    assert 0 < fast < slow
