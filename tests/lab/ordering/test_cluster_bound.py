"""Bounds from nested clusters hold for every order, whatever is taken off the legs."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.ordering import OrderingProblem
from lab.ordering.cluster_bound import bound_at, cluster_bound, nearest_leg_bound, rounding
from lab.ordering.local_search import improve, ratio_rule
from lab.ordering.reduction import ReducedProblem, reduce_problem
from lab.ordering.solver import solve
from lab.ordering.subset_dp import best_order
from tests.lab.ordering.test_solver import scattered

MODELS = ["single", "any"]


@st.composite
def reduced_problems(draw: st.DrawFn) -> ReducedProblem:
    """Two to six places; legs that may break the triangle inequality, some chances 0 or 1."""
    n, seed = draw(st.integers(2, 6)), draw(st.integers(0, 10_000))
    rng = np.random.default_rng(seed)
    at = rng.integers(0, 40, (n + 1, 2)).astype(float)
    T = np.hypot(*(at[:, None] - at).transpose(2, 0, 1)) / 0.25
    if draw(st.booleans()):
        T *= rng.uniform(0.1, 1.0, T.shape)
    p = rng.dirichlet(np.full(n, 0.5)) + 1e-4
    p[0] = draw(st.sampled_from([p[0], 0.0, 1.0]))
    p[-1] = draw(st.sampled_from([p[-1], p[0]])) + 1e-3
    p = np.minimum(p, 1.0)
    model = draw(st.sampled_from(MODELS))
    return reduce_problem(
        OrderingProblem(p, T[1:, 1:], T[0, 1:], rng.uniform(0, 60, n), model)  # type: ignore[arg-type]
    )


def least(reduced: ReducedProblem) -> float:
    orders = itertools.permutations(range(reduced.size))
    return min(reduced.cost(np.array(order)) for order in orders)


@settings(max_examples=80, deadline=None)
@given(reduced_problems(), st.integers(0, 1000), st.sampled_from([0.0, 1.0, 50.0, 500.0]))
def test_clusters_bound_every_order_at_any_price(reduced, seed, size):
    rng, m, optimum = np.random.default_rng(seed), reduced.size, least(reduced)
    slack = 1e-9 * (1 + optimum + size)
    for _ in range(4):
        inward, out = rng.normal(0, size, m), rng.normal(0, size, m + 1)
        assert bound_at(reduced, inward, out).bound <= optimum + slack
    for order in (ratio_rule(reduced), rng.permutation(m)):
        assert cluster_bound(reduced, order, np.inf, steps=60) <= optimum + slack


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_slopes_tell_how_the_bound_changes(model: str, seed: int) -> None:
    problem = scattered(30, seed, model)
    reduced, rng = reduce_problem(problem), np.random.default_rng(seed)
    m = reduced.size
    at, step = rng.normal(20, 10, 2 * m + 1), 1e-5 * rng.normal(0, 1, 2 * m + 1)
    here, there = (bound_at(reduced, x[:m], x[m:]) for x in (at, at + step))
    slope = np.concatenate([here.inward, here.out])
    assert there.bound - here.bound == pytest.approx(slope @ step, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize("model", MODELS)
def test_bounds_are_near_and_below_optima(model: str) -> None:
    for seed in range(6):
        reduced = reduce_problem(scattered(13, seed, model))
        best = best_order(reduced)
        optimum = reduced.cost(best)
        bound = cluster_bound(reduced, best, np.inf, steps=400)
        assert 0.8 * optimum < bound <= optimum * (1 + 1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_steps_raise_the_bound_of_many_places(model: str) -> None:
    reduced = reduce_problem(scattered(60, 0, model))
    order, cost = improve(reduced, ratio_rule(reduced), np.inf, seed=0, perturbations=40)
    quick = nearest_leg_bound(reduced)
    few, some, many = (cluster_bound(reduced, order, np.inf, steps=n) for n in (1, 60, 300))
    assert few < some < many <= cost
    assert quick < many


def test_places_without_probability_are_no_part_of_the_search() -> None:
    some = scattered(330, 0)
    p = np.where(np.arange(330) % 16 == 0, some.p, 0.0)
    problem = OrderingProblem(p / p.sum(), some.T, some.t0, some.explore, "single")
    reduced = reduce_problem(problem)
    assert sorted(reduced.sites) == sorted(np.flatnonzero(problem.p > 0))
    found = solve(problem, 0.3)
    assert sorted(found.order) == list(range(330))
    assert set(found.order[: reduced.size]) == set(reduced.sites)


def test_an_order_of_few_places_is_never_below_its_bound() -> None:
    for model in MODELS:
        found = solve(scattered(50, 1, model), 0.3)
        assert 0 < found.lower_bound <= found.expected_seconds


@pytest.mark.parametrize("least_chance", [1e-6, 1e-12, 1e-15])
def test_bounds_hold_where_probabilities_are_tiny(least_chance: float) -> None:
    """The probability left before such places is no difference of two ones."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        p = least_chance * rng.uniform(0.01, 1.0, 3)
        T, t0, explore = rng.uniform(0, 100, (3, 3)), rng.uniform(0, 100, 3), rng.uniform(0, 30, 3)
        reduced = reduce_problem(OrderingProblem(p, T, t0, explore, "any"))
        bound = cluster_bound(reduced, ratio_rule(reduced), np.inf, steps=60)
        assert 0 < bound <= least(reduced) * (1 + 1e-9)
        assert 0 < nearest_leg_bound(reduced) <= least(reduced) * (1 + 1e-9)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("size", [1e6, 1e9, 1e12])
def test_prices_that_cancel_each_other_change_a_bound_by_rounding_only(model, size):
    for seed in range(8):
        problem = scattered(12, seed, model)
        reduced = reduce_problem(problem)
        m = reduced.size
        inward, out = np.full(m, 20.0), np.zeros(m + 1)
        exact = bound_at(reduced, inward, out).bound
        prices = np.concatenate([inward + size, out - size])
        lifted = bound_at(reduced, prices[:m], prices[m:]).bound - exact
        assert abs(lifted) <= rounding(reduced, prices) <= 1e-12 * size
