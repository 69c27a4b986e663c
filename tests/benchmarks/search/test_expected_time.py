"""The expected time of a search beside the mean of many searches for things that are hidden."""

from __future__ import annotations

import numpy as np

from benchmarks.search.expected_time import HiddenAnywhere
from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.homes import Home, HomeRoom
from benchmarks.search.room_beliefs import RoomChances
from benchmarks.search.view_policy import Ablation, ViewPolicy, initial_state
from planner.freespace.grid import Room
from planner.search.viewpoints.candidate_views import Motion, Sensor


def test_the_expected_time_is_the_mean_over_hiding_places_and_luck() -> None:
    rooms = (
        HomeRoom("kitchen", Room(0, 5, 0, 4), {"cup": 1}),
        HomeRoom("bedroom", Room(5, 9, 0, 4), {}),
    )
    building = HomeSpace(Home("small", rooms, None), Sensor(), Motion())
    start = int(building.space.floor(1)[0])
    chances, manner = RoomChances.apart([0.3, 0.3]), Ablation(give_up_at=0.0005)

    def policy() -> ViewPolicy:
        state = initial_state(building, building.views, chances, manner)
        return ViewPolicy(building, start, state, manner)

    expected = HiddenAnywhere(building, "cup").seconds(policy())
    rng, times = np.random.default_rng(1), []
    for number in range(150):
        cell = int(rng.choice(building.space.floor(0)))
        hidden = HiddenObject(building.space, building.sensor, [cell], f"cup {number}")
        times.append(policy().search(hidden).seconds)
    assert abs(np.mean(times) - expected) < 3.5 * np.std(times) / np.sqrt(len(times))
