"""Bounds from nested clusters hold for every order, whatever is taken off the legs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.ordering_worlds import PATTERNS, Pattern, reference_like
from planner.ordering import OrderingProblem, solve
from planner.ordering.improve import by_ratio, improve
from planner.ordering.kernel import Kernel, reduce_problem
from planner.ordering.potentials import best_split
from planner.ordering.subsets import best_order
from planner.ordering.trees import rise_at, tree_bound

MODELS = ["single", "any"]


@st.composite
def kernels(draw: st.DrawFn) -> Kernel:
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


def least(kernel: Kernel) -> float:
    orders = itertools.permutations(range(kernel.size))
    return min(kernel.cost(np.array(order)) for order in orders)


@settings(max_examples=80, deadline=None)
@given(kernels(), st.integers(0, 1000), st.sampled_from([0.0, 1.0, 50.0, 500.0]))
def test_clusters_bound_every_order_at_any_price(kernel: Kernel, seed: int, size: float) -> None:
    rng, m, optimum = np.random.default_rng(seed), kernel.size, least(kernel)
    slack = 1e-9 * (1 + optimum + size)
    for _ in range(4):
        inward, out = rng.normal(0, size, m), rng.normal(0, size, m + 1)
        assert rise_at(kernel, inward, out).bound <= optimum + slack
    for order in (by_ratio(kernel), rng.permutation(m)):
        assert tree_bound(kernel, order, np.inf, steps=60) <= optimum + slack


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_slopes_tell_how_the_bound_changes(model: str, seed: int) -> None:
    problem = reference_like(30, seed, model, pattern="remainder")  # type: ignore[arg-type]
    kernel, rng = reduce_problem(problem), np.random.default_rng(seed)
    m = kernel.size
    at, step = rng.normal(20, 10, 2 * m + 1), 1e-5 * rng.normal(0, 1, 2 * m + 1)
    here, there = (rise_at(kernel, x[:m], x[m:]) for x in (at, at + step))
    slope = np.concatenate([here.inward, here.out])
    assert there.bound - here.bound == pytest.approx(slope @ step, rel=1e-3, abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(kernels())
def test_clusters_are_no_worse_than_the_split_legs_they_begin_from(kernel: Kernel) -> None:
    cost = kernel.cost(by_ratio(kernel))
    split = best_split(kernel, cost, np.inf)
    rise = rise_at(kernel, split.inward, split.out)
    assert rise.bound >= split.bound - 1e-7 * (1 + abs(split.bound))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_worlds_like_the_reference_keep_bounds_below_optima(model: str, pattern: Pattern) -> None:
    for seed in range(3):
        kernel = reduce_problem(reference_like(13, seed, model, pattern=pattern))  # type: ignore[arg-type]
        if kernel.size < 2:
            continue
        best = best_order(kernel)
        optimum = kernel.cost(best)
        bound = tree_bound(kernel, best, np.inf, steps=400)
        assert 0.8 * optimum < bound <= optimum * (1 + 1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_steps_raise_the_bound_of_many_places(model: str) -> None:
    kernel = reduce_problem(reference_like(60, 0, model, pattern="remainder"))  # type: ignore[arg-type]
    order, cost = improve(kernel, by_ratio(kernel), np.inf, seed=0, kicks=40)
    split = best_split(kernel, cost, np.inf).bound
    few, some, many = (tree_bound(kernel, order, np.inf, steps=n) for n in (1, 60, 300))
    assert few < some < many <= cost
    assert split < many


@pytest.mark.parametrize("pattern", ["uniform", "dirichlet"])
def test_places_without_probability_are_no_part_of_the_search(pattern: Pattern) -> None:
    problem = reference_like(330, 0, "single", pattern=pattern)
    kernel = reduce_problem(problem)
    assert sorted(kernel.sites) == sorted(np.flatnonzero(problem.p > 0))
    found = solve(problem, 0.3)
    assert sorted(found.order) == list(range(330))
    assert set(found.order[: kernel.size]) == set(kernel.sites)


def test_an_order_of_few_places_is_never_below_its_bound() -> None:
    for model in MODELS:
        found = solve(reference_like(50, 1, model, pattern="remainder"), 0.3)  # type: ignore[arg-type]
        assert 0 < found.lower_bound <= found.expected_seconds
