"""Room orders are permutations, near the optimum, and no worse than the ratio rule's."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from planner.search.plans.orders import (
    MAX_CHAIN,
    MAX_IMPROVED,
    expected_cost,
    ratio_rule,
    room_order,
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
