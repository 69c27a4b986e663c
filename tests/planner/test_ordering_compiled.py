"""Compiled bounds hold for every order, agree with numpy's, and their proofs with all subsets."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.ordering import OrderingProblem, compiled, fast, solve, warm_up
from planner.ordering.ascent import ascend
from planner.ordering.exhaust import exhaust
from planner.ordering.improve import by_ratio, improve
from planner.ordering.kernel import Kernel, reduce_problem
from planner.ordering.memories import Memories
from planner.ordering.rises import Rises
from planner.ordering.shares import ShareWalks, units_for
from planner.ordering.subsets import best_order
from planner.ordering.tangent import Tangent
from planner.ordering.timed import TimedWalks
from planner.ordering.trees import Rise, rise_at, rounding, tree_bound
from planner.ordering.walks import Walks
from tests.planner.scattered_problems import MODELS, kernels, scattered, with_no_leg

ROOT = Path(__file__).resolve().parents[2]


def least_cost(kernel: Kernel) -> float:
    orders = itertools.permutations(range(kernel.size))
    return min(kernel.cost(np.array(order)) for order in orders)


def usual_weight(known: Tangent) -> np.ndarray:
    return np.abs(known.marginal) + 1e-6 * np.abs(known.marginal).max()


@settings(max_examples=60)
@given(
    kernels(odd=(0.0, 1e-7, 1.0)), st.integers(0, 1000), st.sampled_from([0.0, 1.0, 50.0, 500.0])
)
def test_compiled_clusters_prove_what_numpy_does_and_bound_every_order(
    kernel: Kernel, seed: int, size: float
) -> None:
    rng, m, optimum = np.random.default_rng(seed), kernel.size, least_cost(kernel)
    slack = 1e-9 * (1 + optimum + size)
    rises = Rises(kernel)
    for _ in range(4):
        inward, out = rng.normal(0, size, m), rng.normal(0, size, m + 1)
        bound = rises.at(inward, out).bound
        assert bound == pytest.approx(rise_at(kernel, inward, out).bound, abs=slack)
        assert bound <= optimum + slack
    bound = tree_bound(kernel, rng.permutation(m), np.inf, steps=60, rises=rises.at)
    assert bound <= optimum + slack


@pytest.mark.parametrize("least", [1e-15, 1e-12, 1e-4, 1.0])
def test_bounds_of_what_is_hardly_there_hold_as_exactly_as_others(least: float) -> None:
    """What is left before such places is next to nothing, and no difference of two ones."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        p = least * rng.uniform(0.01, 1.0, 3)
        T, t0, explore = rng.uniform(0, 100, (3, 3)), rng.uniform(0, 100, 3), rng.uniform(0, 30, 3)
        kernel = reduce_problem(OrderingProblem(p, T, t0, explore, "any"))
        optimum, order = least_cost(kernel), by_ratio(kernel)
        for rises in (Rises(kernel).at, None):
            bound = tree_bound(kernel, order, np.inf, steps=60, rises=rises)
            assert 0 < bound <= optimum * (1 + 1e-9)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("size", [1e6, 1e9, 1e12])
def test_prices_that_cancel_each_other_lift_no_bound(model: str, size: float) -> None:
    """Seconds taken off all legs to places and added to all from them change nothing but digits."""
    for seed in range(8):
        kernel = reduce_problem(scattered(12, seed, model))
        inward, out = np.full(12, 20.0), np.zeros(13)
        exact = rise_at(kernel, inward, out).bound
        prices = np.concatenate([inward + size, out - size])
        for at in (Rises(kernel).at, lambda a, b, k=kernel: rise_at(k, a, b)):
            lifted = at(prices[:12], prices[12:]).bound - exact
            assert abs(lifted) <= rounding(kernel, prices) <= 1e-12 * size


def test_the_best_bound_is_told_less_its_rounding() -> None:
    kernel, told = reduce_problem(scattered(9, 1, "any")), list[float]()

    def lifted(inward: np.ndarray, out: np.ndarray) -> Rise:
        rise = rise_at(kernel, inward, out)
        told.append(rise.bound - rounding(kernel, np.concatenate([inward, out])))
        return rise

    assert tree_bound(kernel, by_ratio(kernel), np.inf, steps=20, rises=lifted) == max(told)


@pytest.mark.parametrize("model", MODELS)
def test_compiled_clusters_have_the_slopes_of_numpy(model: str) -> None:
    for size, seed in ((40, 1), (120, 2)):
        kernel = reduce_problem(scattered(size, seed, model, metric=seed == 1))
        rng, rises = np.random.default_rng(seed), Rises(kernel)
        for _ in range(3):
            inward, out = rng.normal(20, 10, size), rng.normal(20, 10, size + 1)
            ours, theirs = rises.at(inward, out), rise_at(kernel, inward, out)
            assert ours.bound == pytest.approx(theirs.bound, rel=1e-12)
            np.testing.assert_allclose(ours.inward, theirs.inward, atol=1e-12)
            np.testing.assert_allclose(ours.out, theirs.out, atol=1e-12)


@settings(max_examples=60)
@given(kernels(odd=(0.0, 1e-7, 1.0)), st.integers(0, 4), st.integers(0, 1000), st.integers(5, 300))
def test_compiled_walks_bound_every_order_at_any_price(
    kernel: Kernel, memory: int, seed: int, units: int
) -> None:
    if kernel.size < 2:
        return
    known = Tangent.of(kernel, by_ratio(kernel))
    memories = Memories.nearest(kernel, memory)
    optimum = least_cost(kernel)
    rng = np.random.default_rng(seed)
    for walks in (TimedWalks(kernel, known, memories), ShareWalks(kernel, known, memories, units)):
        for _ in range(3):
            price = known.marginal * rng.uniform(0, 2, kernel.size)
            assert walks.bound(price) <= optimum + 1e-9 * (1 + known.total)
        weight = usual_weight(known)
        best = ascend(walks, known.marginal, weight, known.cost, np.inf, most=15)
        assert best.bound <= optimum + 1e-9 * (1 + known.total)


@settings(max_examples=40)
@given(kernels(odd=(0.0, 1e-7, 1.0)), st.integers(0, 2), st.integers(0, 1000))
def test_compiled_and_numpy_walks_agree_where_no_step_is_far(
    kernel: Kernel, more: int, seed: int
) -> None:
    if kernel.size < 2:
        return
    memory = kernel.size - 1 + more  # no step is free, so none is drawn as a line
    known = Tangent.of(kernel, by_ratio(kernel))
    price = known.marginal * np.random.default_rng(seed).uniform(0, 2, kernel.size)
    slow = Walks(kernel, known, memory, kernel.size).solve(price)
    assert slow is not None
    quick = TimedWalks(kernel, known, Memories.nearest(kernel, memory)).bound(price)
    slack = 1e-9 * (1 + known.total + float(price.sum()))
    assert quick == pytest.approx(slow.bound, abs=slack)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("metric", [True, False])
def test_compiled_bounds_of_more_memory_stay_below_the_optimum(model: str, metric: bool) -> None:
    for seed in range(2):
        kernel = reduce_problem(scattered(12, seed, model, metric))
        optimum = kernel.cost(best_order(kernel))
        known = Tangent.of(kernel, by_ratio(kernel))
        for memory in (0, 2, 6):
            memories = Memories.nearest(kernel, memory)
            for walks in (
                TimedWalks(kernel, known, memories),
                ShareWalks(kernel, known, memories, 400),
            ):
                weight = usual_weight(known)
                found = ascend(walks, known.marginal, weight, known.cost, np.inf, most=25)
                assert found.bound <= optimum * (1 + 1e-9)
                assert found.bound == walks.bound(found.price)
        assert found.bound > 0.5 * optimum


def test_walks_that_remember_all_places_and_count_them_cost_what_the_best_order_does() -> None:
    problem = scattered(9, 4, "single")
    p = np.full(9, 1 / 9)
    kernel = reduce_problem(OrderingProblem(p, problem.T, problem.t0, problem.explore))
    walks = ShareWalks(kernel, Tangent.of(kernel, by_ratio(kernel)), Memories.nearest(kernel, 8), 9)
    optimum = kernel.cost(best_order(kernel))
    assert walks.bound(np.zeros(9)) == pytest.approx(optimum, rel=1e-12)
    assert walks.visits(0).tolist() == [1.0] * 9


@pytest.mark.parametrize("model", MODELS)
def test_more_units_lose_less_of_the_known_order(model: str) -> None:
    kernel = reduce_problem(scattered(30, 2, model))
    order = by_ratio(kernel)
    known = Tangent.of(kernel, order)
    units = [units_for(kernel, order, known, loss) for loss in (0.5, 0.05, 0.0)]
    assert units == sorted(units)
    assert units[0] < units[-1]


@pytest.mark.parametrize("model", MODELS)
def test_compiled_exhaustion_agrees_with_all_subsets(model: str) -> None:
    for seed in range(6):
        kernel = reduce_problem(scattered(12, seed, model, metric=seed % 2 == 0))
        optimum = kernel.cost(best_order(kernel))
        start = by_ratio(kernel)
        known = Tangent.of(kernel, start)
        walks = ShareWalks(kernel, known, Memories.nearest(kernel, 4), 300)
        weight = usual_weight(known)
        prices = ascend(walks, known.marginal, weight, known.cost, np.inf, most=30)
        walks.bound(prices.price)
        better = exhaust(walks, prices.price, known.cost, np.inf)
        assert better is not None
        found = better if len(better) else start
        assert sorted(found) == list(range(12))
        assert kernel.cost(found) == pytest.approx(optimum, rel=1e-9)


def test_exhaustion_ends_at_its_deadline_without_a_proof() -> None:
    kernel = reduce_problem(scattered(20, 1, "single"))
    known = Tangent.of(kernel, by_ratio(kernel))
    walks = ShareWalks(kernel, known, Memories.nearest(kernel, 2), 300)
    walks.bound(known.marginal)
    assert exhaust(walks, known.marginal, known.cost, time.perf_counter() - 1.0) is None


@pytest.mark.parametrize("model", MODELS)
def test_few_places_are_proven_at_what_a_longer_search_finds(model: str) -> None:
    for seed in range(2):
        kernel = reduce_problem(scattered(18, seed, model))
        start = by_ratio(kernel)
        order, bound = fast.bounded(kernel, start, time.perf_counter() + 120.0)
        _, cost = improve(kernel, start, np.inf, seed=0, kicks=40)
        assert bound == np.inf
        assert sorted(order) == list(range(18))
        assert kernel.cost(order) <= cost * (1 + 1e-9)


@pytest.fixture
def warm() -> Iterator[None]:
    """Compiled steps for `solve`, in this test alone."""
    assert warm_up() is not None, "numba is missing: pip install hereabouts[fast]"
    yield
    compiled.cool_down()


@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("size", [24, 90])
def test_solve_with_compiled_steps_keeps_its_bound(model: str, size: int) -> None:
    problem = scattered(size, 3, model)
    found = solve(problem, time_limit=0.6)
    kernel = reduce_problem(problem)
    assert sorted(found.order) == list(range(size))
    assert 0 < found.lower_bound <= found.expected_seconds
    assert found.expected_seconds <= kernel.cost(by_ratio(kernel)) / kernel.norm * (1 + 1e-12)
    assert found.expected_seconds == problem.expected_seconds(found.order)


@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize("model", MODELS)
def test_places_without_legs_between_them_are_left_to_other_bounds(model: str) -> None:
    found = solve(with_no_leg(24, 2, model), 0.3)
    assert 0 < found.lower_bound <= found.expected_seconds


@pytest.mark.usefixtures("warm")
def test_a_certain_place_keeps_the_compiled_bound_finite() -> None:
    problem = scattered(25, 7, "any")
    p = problem.p.copy()
    p[4] = 1.0
    found = solve(OrderingProblem(p, problem.T, problem.t0, problem.explore, "any"), 0.5)
    assert 0 < found.lower_bound <= found.expected_seconds < np.inf


def test_without_a_warm_up_nothing_compiled_is_loaded() -> None:
    code = (
        "import sys, numpy as np\n"
        "from planner.ordering import OrderingProblem, solve\n"
        "T = np.ones((20, 20)); o = np.ones(20)\n"
        "assert solve(OrderingProblem(o / 20, T, o, o), 0.05).lower_bound > 0\n"
        "assert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_without_numba_numpy_does_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled.importlib.util, "find_spec", lambda name: None)
    assert warm_up() is None
    assert compiled.fast() is None
    assert solve(scattered(24, 1, "single"), 0.3).lower_bound > 0
