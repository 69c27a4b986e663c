"""The rule of the thesis: travel, the nearest goal first, and the expected time."""

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map
from planner.search.goals.search_goals import Goal
from planner.search.plans.thesis_rules import (
    Travel,
    arrival_seconds,
    expected_seconds,
    nearest_first,
    plan_search,
    travelled,
)

shares = st.floats(0, 1, allow_nan=False)


def test_a_leg_costs_its_length_over_the_speed_and_every_stop_a_look() -> None:
    arrivals = arrival_seconds((0, 0), [(3, 4), (3, 10)], Travel(speed=0.5, explore=10))
    assert arrivals.tolist() == [5 / 0.5 + 10, 11 / 0.5 + 20]
    assert travelled((0, 0), [(3, 4), (3, 10)]).tolist() == [5, 11]
    usual = arrival_seconds((0, 0), [(0, 2.412)])  # fitted to the thesis
    assert usual.tolist() == pytest.approx([10 + 41.79])


@given(st.lists(st.tuples(st.floats(1, 500), shares), min_size=1, max_size=6))
def test_any_is_the_mean_over_every_way_instances_may_lie(stops: list[tuple[float, float]]) -> None:
    arrivals, p = sorted(when for when, _ in stops), [share for _, share in stops]
    weight = total = 0.0
    for world in itertools.product([False, True], repeat=len(p)):
        chance = math.prod(q if here else 1 - q for q, here in zip(p, world, strict=True))
        if any(world):
            weight += chance
            total += chance * arrivals[world.index(True)]
    computed = expected_seconds(arrivals, p)
    if weight < 1e-9:
        assert computed is None or computed <= arrivals[-1] * (1 + 1e-9)
    else:
        assert computed == pytest.approx(total / weight)


def test_without_stops_or_probability_there_is_no_expected_time() -> None:
    assert expected_seconds([], []) is None
    assert expected_seconds([10, 20], [0, 0]) is None


def test_an_impossible_speed_is_refused() -> None:
    with pytest.raises(ValueError, match="speed must be > 0"):
        Travel(speed=0)


def goal(name: str, x: float, y: float, probability: float = 0.5) -> Goal:
    return Goal(name, "known", name, np.array([x, y], dtype=np.float64), probability, f"{name}!")


metres = st.floats(-30, 30, allow_nan=False)
goals = st.lists(st.tuples(metres, metres, st.floats(0.01, 1)), min_size=1, max_size=8).map(
    lambda rows: [goal(f"o{i}", x, y, p) for i, (x, y, p) in enumerate(rows)]
)
start = st.tuples(metres, metres)


def test_of_goals_equally_near_the_more_probable_comes_first() -> None:
    plan = nearest_first((0, 0), [goal("a", 1, 0, 0.2), goal("b", -1, 0, 0.9)])
    assert [step.goal.iri for step in plan.steps] == ["b", "a"]


@given(start, goals)
def test_nearest_first_visits_every_goal_once_and_always_the_nearest_that_is_left(
    begin: tuple[float, float], given_goals: list[Goal]
) -> None:
    plan = nearest_first(begin, given_goals)
    assert sorted(s.goal.iri for s in plan.steps) == sorted(g.iri for g in given_goals)
    here, left = np.array(begin), {g.iri: g for g in given_goals}
    for step in plan.steps:
        nearest = min(math.dist(here, g.p_map) for g in left.values())
        assert math.dist(here, step.goal.p_map) == pytest.approx(nearest)
        here = left.pop(step.goal.iri).p_map
    seconds = [step.seconds for step in plan.steps]
    assert all(later > earlier for earlier, later in itertools.pairwise(seconds))


def test_a_plan_reads_as_plain_json() -> None:
    goals = [goal("b", 3, 4, 0.25), goal("a", 1, 0, 1.0)]
    plan = nearest_first((0, 0), goals, target="cup", travel=Travel(1.0, 5.0))
    told = json.loads(json.dumps(plan.to_json()))
    assert (told["target"], told["expected_seconds"]) == ("cup", 6.0)
    near, far = told["goals"]
    assert near == {
        "iri": "a",
        "kind": "known",
        "x": 1.0,
        "y": 0.0,
        "probability": 1.0,
        "why": "a!",
        "distance": 1.0,
        "seconds": 6.0,
    }
    assert (far["distance"], far["seconds"]) == (5.472, 15.472)


def test_a_search_starts_where_the_robot_is_and_explains_why_there_is_no_goal() -> None:
    with in_memory_map() as home:
        empty = plan_search(home, "toilet")
        assert empty.to_json() == {"target": "toilet", "goals": [], "expected_seconds": None}
        assert "shower" in empty.explanation
        bath = home.catalogue.find("shower", "place").iri
        home.apply(
            MapUpdate(
                places=tuple(
                    PlaceRecord(home.place_iri(n), f"bath {n}", x, x + 2, 0, 2, 1, {bath: 1.0})
                    for n, x in ((1, 0.0), (2, 10.0))
                ),
                robot=RobotRecord(np.array([11.0, 1.0, 1.2]), 0.0, 1e9),
            )
        )
        here, there = plan_search(home, "toilet"), plan_search(home, "toilet", (0, 0))
        assert [step.goal.label for step in here.steps] == ["bath 2", "bath 1"]
        assert [step.goal.label for step in there.steps] == ["bath 1", "bath 2"]
        assert (here.steps[0].distance, here.explanation) == (0.0, "")
