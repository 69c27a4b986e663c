"""Bounds from walks hold for every order, whatever the prices, the memory and the grid."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.ordering import solve
from planner.ordering.improve import by_ratio, improve
from planner.ordering.kernel import Ints, Kernel, reduce_problem
from planner.ordering.prove import prove
from planner.ordering.subsets import best_order
from planner.ordering.tangent import Tangent
from planner.ordering.walks import Walks, fits, raise_prices
from tests.planner.scattered_problems import MODELS, kernels, scattered, with_no_leg


def orders(kernel: Kernel) -> list[Ints]:
    return [np.array(order) for order in itertools.permutations(range(kernel.size))]


@settings(max_examples=30, deadline=None)
@given(kernels(), st.randoms(use_true_random=False))
def test_the_tangent_is_below_every_order_and_meets_its_own(kernel: Kernel, rng: object) -> None:
    known = np.array(rng.sample(range(kernel.size), kernel.size))  # type: ignore[attr-defined]
    tangent = Tangent.of(kernel, known)
    for order in orders(kernel):
        before = np.append(kernel.root, order[:-1])
        arrival = np.cumsum(kernel.D[before, order])
        value = tangent.base + float(tangent.a[order] @ tangent.phi(arrival))
        assert value <= kernel.cost(order) + 1e-8 * tangent.total
        if (order == known).all():
            assert value == pytest.approx(kernel.cost(order), rel=1e-7, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(kernels(), st.integers(0, 3), st.integers(1, 5), st.integers(0, 1000))
def test_walks_bound_every_order_at_any_price(
    kernel: Kernel, memory: int, nearest: int, seed: int
) -> None:
    known = Tangent.of(kernel, by_ratio(kernel))
    if not fits(kernel, known, memory) or kernel.size < 2:
        return
    walks = Walks(kernel, known, memory, nearest)
    optimum = min(kernel.cost(order) for order in orders(kernel))
    rng = np.random.default_rng(seed)
    for _ in range(3):
        values = walks.solve(known.marginal * rng.uniform(0, 2, kernel.size))
        assert values is not None
        assert values.bound <= optimum + 1e-9 * (1 + known.total)
    best = raise_prices(walks, known.cost, np.inf, 20)
    assert best is not None
    assert best.bound <= optimum + 1e-9 * (1 + known.total)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("metric", [True, False])
def test_far_steps_and_memory_keep_the_bound_below_the_optimum(model: str, metric: bool) -> None:
    for seed in range(3):
        kernel = reduce_problem(scattered(12, seed, model, metric))
        optimum = kernel.cost(best_order(kernel))
        known = Tangent.of(kernel, by_ratio(kernel))
        bounds = []
        for memory, nearest in ((0, 4), (2, 4), (4, 11)):
            values = raise_prices(Walks(kernel, known, memory, nearest), known.cost, np.inf, 40)
            assert values is not None
            bounds.append(values.bound)
        assert max(bounds) <= optimum * (1 + 1e-9)
        assert bounds[-1] > 0.5 * optimum


@pytest.mark.parametrize("model", MODELS)
def test_prices_rise_to_a_close_bound(model: str) -> None:
    kernel = reduce_problem(scattered(16, 1, model))
    order, cost = improve(kernel, by_ratio(kernel), np.inf, seed=0, kicks=60)
    walks = Walks(kernel, Tangent.of(kernel, order), 5, 10)
    first = walks.solve(walks.known.marginal)
    best = raise_prices(walks, cost, np.inf, 60)
    assert first is not None
    assert best is not None
    assert first.bound < best.bound <= cost * (1 + 1e-9)
    assert best.bound > 0.9 * cost


@pytest.mark.parametrize("model", MODELS)
def test_proofs_beyond_all_subsets_agree_with_all_subsets(model: str) -> None:
    for seed in range(4):
        kernel = reduce_problem(scattered(12, seed, model, metric=seed % 2 == 0))
        optimum = kernel.cost(best_order(kernel))
        start = by_ratio(kernel)
        walks = Walks(kernel, Tangent.of(kernel, start), 4, 8)
        values = raise_prices(walks, walks.known.cost, np.inf, 30)
        assert values is not None
        better = prove(kernel, walks, values, np.inf, walks.known.cost)
        assert better is not None
        found = kernel.cost(better if len(better) else start)
        assert found == pytest.approx(optimum, rel=1e-9)


def test_a_deadline_ends_the_table_of_values() -> None:
    kernel = reduce_problem(scattered(40, 1, "single"))
    walks = Walks(kernel, Tangent.of(kernel, by_ratio(kernel)), 2, 8)
    assert walks.solve(walks.known.marginal, deadline=0.0) is None
    assert raise_prices(walks, walks.known.cost, 0.0, 10) is None


@pytest.mark.parametrize("model", MODELS)
def test_places_without_legs_between_them_fall_back_on_split_legs(model: str) -> None:
    found = solve(with_no_leg(24, 2, model), 0.3)
    assert 0 < found.lower_bound <= found.expected_seconds
