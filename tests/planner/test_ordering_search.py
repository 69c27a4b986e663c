"""The compiled search: moves gain what they say, orders only get better, the seed decides all."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.ordering import descent, stretches
from planner.ordering.horn import horn, left_along
from planner.ordering.improve import by_ratio, improve
from planner.ordering.kernel import Kernel, reduce_problem
from planner.ordering.search import Search, searched
from planner.ordering.subsets import best_order
from tests.planner.scattered_problems import MODELS, kernels, scattered


def never() -> bool:
    return False


def sums_of(kernel: Kernel, order: np.ndarray) -> tuple[np.ndarray, ...]:
    m = kernel.size
    w = np.minimum(kernel.w, 1 - 1e-9) if kernel.any else kernel.w
    legs = np.zeros((m + 1, m + 1))
    legs[:, :m] = kernel.D
    place = np.full(m + 2, m, dtype=np.int64)
    place[1:-1] = order
    position, sums = np.zeros(m + 1, dtype=np.int64), np.zeros((stretches.ROWS, m + 2))
    keep = 1.0 - w if kernel.any else np.ones(m)
    stretches.renew(place, position, sums, legs, w, keep, 1)
    return place, sums, legs


@settings(max_examples=60)
@given(kernels(odd=(0.0, 1e-7, 1.0)), st.randoms(use_true_random=False))
def test_the_gain_of_every_compiled_move_is_what_the_cost_falls_by(
    kernel: Kernel, rng: Any
) -> None:
    m = kernel.size
    order = np.array(rng.sample(range(m), m))
    place, sums, legs = sums_of(kernel, order)
    cost, room = kernel.cost(order), np.empty(m + 2, dtype=np.int64)
    assert sums[stretches.COST, m] == pytest.approx(cost, rel=1e-6, abs=1e-5)
    end = int(descent.last_worth(sums, m))
    moves = [(i, j, j, -1) for i in range(1, end) for j in range(i + 1, end + 1)]
    for i in range(1, end):
        for c in range(i, end):
            moves += [(i, c, j, turn) for j in range(c + 1, end + 1) for turn in range(4)]
    for i, c, j, turn in moves:
        changed = place.copy()
        stretches.make(changed, i, c, j, turn, room)
        assert sorted(changed[1:-1]) == list(range(m))
        gain = stretches.gain(place, sums, legs, i, c, j, turn)
        assert gain == pytest.approx(cost - kernel.cost(changed[1:-1]), rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_the_search_ends_at_the_optimum_of_twelve_places(model: str) -> None:
    for seed in range(6):
        kernel = reduce_problem(scattered(12, seed, model, metric=seed % 2 == 0))
        order, cost = searched(kernel, np.inf, seed=0, kicks=400)
        optimum = kernel.cost(best_order(kernel))
        assert sorted(order) == list(range(12))
        assert cost == pytest.approx(kernel.cost(order), rel=1e-9)
        assert optimum <= cost * (1 + 1e-12)
        assert cost <= 1.001 * optimum


@pytest.mark.parametrize("model", MODELS)
def test_of_many_places_the_search_is_no_worse_than_that_by_numpy(model: str) -> None:
    kernel = reduce_problem(scattered(120, 5, model))
    _, slow = improve(kernel, by_ratio(kernel), np.inf, seed=0, kicks=20)
    order, cost = searched(kernel, np.inf, seed=0, kicks=600)
    assert sorted(order) == list(range(120))
    assert cost <= slow


@settings(max_examples=30)
@given(kernels(odd=(0.0, 1.0)), st.integers(0, 100))
def test_any_small_problem_can_be_searched(kernel: Kernel, seed: int) -> None:
    if kernel.size < 2:
        return
    order, cost = searched(kernel, np.inf, seed, kicks=10)
    assert sorted(order) == list(range(kernel.size))
    assert cost <= kernel.cost(by_ratio(kernel)) * (1 + 1e-6)


def test_the_same_seed_makes_the_same_search_and_kicks_go_on_where_they_ended() -> None:
    kernel = reduce_problem(scattered(70, 1, "single"))
    first, second = (Search(kernel, by_ratio(kernel), 4) for _ in range(2))
    first.run(64, never)
    for _ in range(4):
        second.run(16, never)
    assert first.order.tolist() == second.order.tolist()
    assert first.cost == second.cost
    once, again = (searched(kernel, np.inf, 7, kicks=50)[0].tolist() for _ in range(2))
    assert once == again


def test_any_whole_number_is_a_seed() -> None:
    kernel = reduce_problem(scattered(20, 1, "single"))
    for seed in (-1, (1 << 64) + 3):
        once, again = (searched(kernel, np.inf, seed, kicks=3)[0].tolist() for _ in range(2))
        assert once == again


def test_kicks_never_make_an_order_worse() -> None:
    search = Search(kernel := reduce_problem(scattered(60, 2, "any")), by_ratio(kernel), 0)
    costs = [search.cost]
    for _ in range(12):
        search.run(8, never)
        costs.append(search.cost)
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_a_search_that_is_late_returns_the_order_it_has() -> None:
    kernel = reduce_problem(scattered(90, 3, "single"))
    order, cost = searched(kernel, time.perf_counter() - 1.0, seed=0)
    assert sorted(order) == list(range(90))
    assert cost <= kernel.cost(by_ratio(kernel)) * (1 + 1e-12)


@settings(max_examples=60)
@given(st.integers(0, 100_000), st.integers(2, 5), st.booleans())
def test_jobs_in_nested_precedence_are_scheduled_best(seed: int, places: int, some: bool) -> None:
    """Beside every sequence in which a cluster's job comes before those of what lies in it."""
    rng = np.random.default_rng(seed)
    clusters = int(rng.integers(1, 3))
    n = places + clusters + 1
    parent = np.full(n, n - 1, dtype=np.int64)
    parent[:places] = rng.integers(places, n, places)
    if clusters > 1:
        parent[places] = rng.choice([places + 1, n - 1])
    idle = np.zeros(n, dtype=np.bool_)
    idle[-1] = True
    w, cost = rng.uniform(0.05, 0.6, places), rng.uniform(-20, 100, n)
    cost[-1] = 0.0
    cost[places:-1] = np.abs(cost[places:-1])
    jobs = np.empty(n, dtype=np.int64)
    count = horn(parent, idle, cost, w, some, jobs)
    assert sorted(jobs[:count]) == list(range(n - 1))

    def total(sequence: list[int]) -> float:
        before, after = np.zeros(n), np.zeros(places)
        left_along(np.array(sequence, dtype=np.int64), len(sequence), w, some, before, after)
        return float(cost @ before)

    def least(done: list[int]) -> float:
        ready = [
            k for k in range(n - 1) if k not in done and (parent[k] == n - 1 or parent[k] in done)
        ]
        return min(least([*done, k]) for k in ready) if ready else total(done)

    assert total(list(jobs[:count])) == pytest.approx(least([]), rel=1e-9, abs=1e-9)
