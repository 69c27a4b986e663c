"""Orders of rooms, travel, and the rules of the thesis."""

from __future__ import annotations

import itertools
import json
import math
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map
from planner.search.goals.search_goals import Goal
from planner.search.plans.orders import (
    MAX_CHAIN,
    MAX_IMPROVED,
    expected_cost,
    nearest_neighbour,
    ratio_rule,
    room_order,
)
from planner.search.plans.thesis_rules import (
    Travel,
    arrival_seconds,
    brute_force,
    distances,
    expected_seconds,
    nearest_first,
    plan_search,
    travelled,
)


def _rooms(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(p, first, between) of rooms in a square of 15 m, at 0.25 m/s and 10 to 60 s a room."""
    rng = np.random.default_rng(seed)
    xy, start = rng.uniform(0, 15, (count, 2)), rng.uniform(0, 15, 2)
    sweeps, p = rng.uniform(10, 60, count), rng.dirichlet(np.full(count, 0.5))
    between = np.linalg.norm(xy[:, None] - xy[None], axis=2) / 0.25
    return p, np.linalg.norm(xy - start, axis=1) / 0.25 + sweeps, between + sweeps


@pytest.mark.parametrize("seed", range(20))
def test_orders_of_six_rooms_are_within_five_percent_of_the_best(seed: int) -> None:
    p, first, between = _rooms(6, seed)
    every = np.array(list(permutations(range(6))))
    best = float(expected_cost(every, p, first, between).min())
    found = float(expected_cost(room_order(p, first, between)[None], p, first, between)[0])
    assert best <= found * (1 + 1e-12)
    assert found <= 1.05 * best


@example(12, 3)
@given(st.integers(3, 7), st.integers(0, 10**6))
def test_no_moved_chain_and_no_reversal_makes_an_order_cheaper(count: int, seed: int) -> None:
    p, first, between = _rooms(count, seed)
    order = room_order(p, first, between).tolist()
    others = [
        [*order[:i], *order[i:j][::-1], *order[j:]] for i, j in combinations(range(count + 1), 2)
    ]
    for i, j in combinations(range(count + 1), 2):
        rest, chain = [*order[:i], *order[j:]], order[i:j]
        if len(chain) <= MAX_CHAIN:
            others += [[*rest[:at], *chain, *rest[at:]] for at in range(len(rest) + 1)]
    costs = expected_cost(np.array([order, *others]), p, first, between)
    assert costs[0] <= costs.min() * (1 + 1e-9)


@pytest.mark.parametrize("count", [1, 2, 25, MAX_IMPROVED + 1])
def test_an_order_is_a_permutation_no_worse_than_the_ratio_rule(count: int) -> None:
    p, first, between = _rooms(count, 3)
    order, greedy = room_order(p, first, between), ratio_rule(p, first, between)
    assert sorted(order) == list(range(count))
    costs = expected_cost(np.array([order, greedy]), p, first, between)
    assert costs[0] <= costs[1]


def test_a_crowded_corner_comes_before_a_likelier_room_far_off() -> None:
    p = np.array([0.4, 0.2, 0.2, 0.2])
    first = np.array([100.0, 30.0, 35.0, 35.0])
    between = np.full((4, 4), 10.0)
    between[0, :] = between[:, 0] = 100.0
    assert room_order(p, first, between)[-1] == 0


def test_expected_cost_is_the_sum_of_probability_times_arrival() -> None:
    p, first = np.array([0.25, 0.75]), np.array([4.0, 8.0])
    between = np.array([[0.0, 10.0], [3.0, 0.0]])
    costs = expected_cost(np.array([[0, 1], [1, 0]]), p, first, between)
    assert costs == pytest.approx([0.25 * 4 + 0.75 * 14, 0.75 * 8 + 0.25 * 11])


def test_the_ratio_rule_counts_the_way_from_the_last_room_not_to_it() -> None:
    p, first = np.array([0.5, 0.25, 0.25]), np.array([1.0, 9.0, 9.0])
    between = np.array([[0.0, 10.0, 2.0], [2.0, 0.0, 5.0], [10.0, 5.0, 0.0]])
    assert ratio_rule(p, first, between).tolist() == [0, 2, 1]


def test_the_nearest_is_chosen_anew_after_each_item() -> None:
    def metres(here: int | None, item: int) -> float:
        return abs(item - (0 if here is None else here))

    assert list(nearest_neighbour([-2, 1, 3], metres)) == [1, 3, -2]


def test_of_items_equally_near_the_first_given_comes_first() -> None:
    assert list(nearest_neighbour("bca", lambda here, item: 0.0)) == ["b", "c", "a"]


def test_distances_may_depend_on_what_happens_between_the_items() -> None:
    at = [0.0]
    order = []
    for item in nearest_neighbour([1.0, 4.0, 9.0], lambda _, item: abs(item - at[0])):
        order.append(item)
        at[0] = 10.0
    assert order == [1.0, 9.0, 4.0]


coordinate = st.floats(-50, 50, allow_nan=False)
positions = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=7)
shares = st.floats(0, 1, allow_nan=False)


def test_a_leg_costs_its_length_over_the_speed_and_every_stop_a_look() -> None:
    arrivals = arrival_seconds((0, 0), [(3, 4), (3, 10)], Travel(speed=0.5, explore=10))
    assert arrivals.tolist() == [5 / 0.5 + 10, 11 / 0.5 + 20]


def test_the_default_cost_is_the_one_fitted_to_the_thesis() -> None:
    assert arrival_seconds((0, 0), [(0, 2.412)]).tolist() == pytest.approx([10 + 41.79])


def test_distances_are_straight_lines() -> None:
    assert distances((1, 1), [(4, 5), (1, 1)]).tolist() == [5, 0]


@given(positions)
def test_travelled_metres_never_shrink_and_end_at_the_length_of_the_path(
    stops: list[tuple[float, float]],
) -> None:
    metres = travelled((0, 0), stops)
    length = sum(math.dist(a, b) for a, b in itertools.pairwise([(0.0, 0.0), *stops]))
    assert np.all(np.diff(metres) >= 0)
    assert metres[-1] == pytest.approx(length)


@given(st.lists(st.tuples(st.floats(1, 500), shares), min_size=1, max_size=6))
def test_any_is_the_mean_over_every_way_instances_may_lie(
    stops: list[tuple[float, float]],
) -> None:
    arrivals, p = sorted(when for when, _ in stops), [share for _, share in stops]
    weight = total = 0.0
    for world in itertools.product([False, True], repeat=len(p)):
        chance = math.prod(q if here else 1 - q for q, here in zip(p, world, strict=True))
        if any(world):
            weight += chance
            total += chance * arrivals[world.index(True)]
    computed = expected_seconds(arrivals, p, "any")
    if weight < 1e-9:
        assert computed is None or computed <= arrivals[-1] * (1 + 1e-9)
    else:
        assert computed == pytest.approx(total / weight)


def test_single_weighs_arrivals_by_probability() -> None:
    assert expected_seconds([10, 20, 40], [0.2, 0.0, 0.1], "single") == pytest.approx(20)


def test_certainty_at_the_first_stop_makes_the_rest_irrelevant() -> None:
    assert expected_seconds([10, 20], [1.0, 0.7], "any") == pytest.approx(10)


@pytest.mark.parametrize("model", ["single", "any"])
def test_without_stops_or_probability_there_is_no_expected_time(model: str) -> None:
    assert expected_seconds([], [], model) is None  # type: ignore[arg-type]
    assert expected_seconds([10, 20], [0, 0], model) is None  # type: ignore[arg-type]


def test_impossible_input_is_refused_with_what_was_given() -> None:
    with pytest.raises(ValueError, match=r"got \(2,\), \(1,\)"):
        expected_seconds([10, 20], [0.5])
    with pytest.raises(ValueError, match=r"got 0\.5 to 1\.5"):
        expected_seconds([10, 20], [0.5, 1.5], "any")
    with pytest.raises(ValueError, match="speed must be > 0"):
        Travel(speed=0)


def goal(name: str, x: float, y: float, probability: float = 0.5) -> Goal:
    return Goal(name, "known", name, np.array([x, y], dtype=np.float64), probability, f"{name}!")


def place(number: int, x: float, y: float) -> PlaceRecord:
    return PlaceRecord(f"place/{number}", f"place {number}", x - 1, x + 1, y - 1, y + 1)


metres = st.floats(-30, 30, allow_nan=False)
goals = st.lists(st.tuples(metres, metres, st.floats(0.01, 1)), min_size=1, max_size=8).map(
    lambda rows: [goal(f"o{i}", x, y, p) for i, (x, y, p) in enumerate(rows)]
)
start = st.tuples(metres, metres)


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


@given(start, st.lists(st.tuples(metres, metres), min_size=1, max_size=8))
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
