from __future__ import annotations

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
    brute_force,
    nearest_first,
    plan_search,
)


def goal(name: str, x: float, y: float, probability: float = 0.5) -> Goal:
    return Goal(name, "known", name, np.array([x, y], dtype=np.float64), probability, f"{name}!")


def place(number: int, x: float, y: float) -> PlaceRecord:
    return PlaceRecord(f"place/{number}", f"place {number}", x - 1, x + 1, y - 1, y + 1)


coordinate = st.floats(-30, 30, allow_nan=False)
goals = st.lists(st.tuples(coordinate, coordinate, st.floats(0.01, 1)), min_size=1, max_size=8).map(
    lambda rows: [goal(f"o{i}", x, y, p) for i, (x, y, p) in enumerate(rows)]
)
start = st.tuples(coordinate, coordinate)


def test_nearest_first_sorts_anew_from_where_each_look_failed() -> None:
    # from the start c is nearer than b, from a it is not
    plan = nearest_first((0, 0), [goal("c", -2, 0), goal("a", 1, 0), goal("b", 3, 0)])
    assert [step.goal.iri for step in plan.steps] == ["a", "b", "c"]


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


@given(start, st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8))
def test_brute_force_explores_every_place_once(
    begin: tuple[float, float], centres: list[tuple[float, float]]
) -> None:
    plan = brute_force(begin, [place(i, x, y) for i, (x, y) in enumerate(centres)])
    assert sorted(s.goal.iri for s in plan.steps) == sorted(
        f"place/{i}" for i in range(len(centres))
    )
    seconds = [step.seconds for step in plan.steps]
    assert seconds == sorted(seconds)
    assert plan.expected_seconds == pytest.approx(np.mean(seconds))


def test_a_plan_reads_as_plain_json() -> None:
    plan = nearest_first(
        (0, 0), [goal("b", 3, 4, 0.25), goal("a", 1, 0, 1.0)], target="cup", travel=Travel(1.0, 5.0)
    )
    assert json.loads(json.dumps(plan.to_json())) == {
        "target": "cup",
        "goals": [
            {
                "iri": "a",
                "kind": "known",
                "x": 1.0,
                "y": 0.0,
                "probability": 1.0,
                "why": "a!",
                "distance": 1.0,
                "seconds": 6.0,
            },
            {
                "iri": "b",
                "kind": "known",
                "x": 3.0,
                "y": 4.0,
                "probability": 0.25,
                "why": "b!",
                "distance": 5.472,
                "seconds": 15.472,
            },
        ],
        "expected_seconds": 6.0,
    }
    assert nearest_first((0, 0), [], target="cup").to_json() == {
        "target": "cup",
        "goals": [],
        "expected_seconds": None,
    }


def test_a_search_starts_where_the_robot_is_unless_told_otherwise() -> None:
    with in_memory_map() as home:
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
        here = plan_search(home, "toilet")
        there = plan_search(home, "toilet", (0, 0))
        assert [step.goal.label for step in here.steps] == ["bath 2", "bath 1"]
        assert [step.goal.label for step in there.steps] == ["bath 1", "bath 2"]
        assert here.steps[0].distance == 0.0
        assert there.expected_seconds is not None
        assert here.explanation == ""


def test_a_plan_without_goals_explains_itself() -> None:
    with in_memory_map() as home:
        plan = plan_search(home, "toilet")
    assert plan.steps == ()
    assert plan.to_json() == {"target": "toilet", "goals": [], "expected_seconds": None}
    assert "shower" in plan.explanation
