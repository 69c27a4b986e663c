"""Beliefs after failed looks obey Bayes' rule, and a search comes back only where it pays."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.ordering import OrderingProblem
from benchmarks.ordering.problem import OrderingError
from benchmarks.plan.imperfect_detection import missed, plan_with_misses, update_after_miss

SHARE = st.floats(0.01, 0.99)


@given(st.lists(SHARE, min_size=1, max_size=5), SHARE, st.data())
def test_single_follows_bayes_over_all_worlds(
    weights: list[float], detection: float, data: st.DataObject
) -> None:
    nowhere = data.draw(SHARE)
    prior = np.array(weights) / (sum(weights) + nowhere)
    k = data.draw(st.integers(0, len(prior) - 1))
    worlds = np.append(prior, 1 - prior.sum())
    worlds[k] *= 1 - detection
    assert update_after_miss(prior, k, detection) == pytest.approx((worlds / worlds.sum())[:-1])


@given(st.lists(SHARE, min_size=1, max_size=4), SHARE, st.data())
def test_any_follows_bayes_over_all_worlds(
    p: list[float], detection: float, data: st.DataObject
) -> None:
    k = data.draw(st.integers(0, len(p) - 1))
    posterior, total = np.zeros(len(p)), 0.0
    for present in itertools.product((0, 1), repeat=len(p)):
        chance = np.prod([q if here else 1 - q for q, here in zip(p, present, strict=True)])
        chance *= 1 - detection if present[k] else 1
        posterior += chance * np.array(present)
        total += chance
    assert update_after_miss(p, k, detection, "any") == pytest.approx(posterior / total)


@given(SHARE, st.floats(0, 1), st.integers(0, 6))
def test_repeated_looks_help_less_and_less(detection: float, rho: float, looks: int) -> None:
    row = missed(np.arange(looks + 3), detection, rho)
    assert row[:2] == pytest.approx([1, 1 - detection])
    gains = -np.diff(row)
    assert np.all(gains >= -1e-15)
    assert np.all(np.diff(gains) <= 1e-12)
    assert np.all(row >= (1 - detection) ** np.arange(looks + 3) - 1e-12)


def row_of_rooms(p: list[float], model: str = "single") -> OrderingProblem:
    x = np.arange(len(p)) * 20.0
    T = np.abs(x[:, None] - x)
    return OrderingProblem(np.array(p), T, x + 5, np.full(len(p), 10.0), model)  # type: ignore[arg-type]


@pytest.mark.parametrize("model", ["single", "any"])
def test_the_plan_says_what_really_happens(model: str) -> None:
    problem = row_of_rooms([0.5, 0.2, 0.2], model)
    plan = plan_with_misses(problem, 0.7, epsilon=0.05)
    rng = np.random.default_rng(1)
    runs = 20_000
    if model == "single":
        where = rng.choice(4, size=runs, p=[0.5, 0.2, 0.2, 0.1])
        present = where[:, None] == np.arange(3)
    else:
        present = rng.random((runs, 3)) < problem.p
    found_at = np.full(runs, np.inf)
    for stop in plan.stops:
        hit = present[:, stop.site] & (rng.random(runs) < 0.7) & np.isinf(found_at)
        found_at[hit] = stop.seconds
    found = np.isfinite(found_at)
    assert found.mean() == pytest.approx(plan.found, abs=0.015)
    assert found_at[found].mean() == pytest.approx(plan.expected_seconds, rel=0.03)
    assert (present.any(axis=1) & ~found).mean() == pytest.approx(plan.stops[-1].left, abs=0.015)
    assert plan.ending == "epsilon"
    assert plan.stops[-1].left < 0.05 <= plan.stops[-2].left


def test_looks_that_cannot_fail_come_once() -> None:
    plan = plan_with_misses(row_of_rooms([0.5, 0.3, 0.2]), 1.0, epsilon=0)
    assert [stop.site for stop in plan.stops] == [0, 1, 2]
    assert plan.found == pytest.approx(1)
    assert plan.ending == "epsilon"


def test_a_likely_place_is_looked_at_again_unless_its_misses_last() -> None:
    rooms = row_of_rooms([0.7, 0.2, 0.1])
    again = [stop.site for stop in plan_with_misses(rooms, 0.6, epsilon=0.1).stops]
    assert again[:2] == [0, 0]
    once = plan_with_misses(rooms, 0.6, rho=1.0, epsilon=0.1)
    assert [stop.site for stop in once.stops] == [0, 1, 2]
    assert once.ending == "price"
    assert once.found == pytest.approx(0.6)


def test_a_search_stops_at_its_price() -> None:
    rooms = row_of_rooms([0.6, 0.01, 0.3])
    cheap, dear = (plan_with_misses(rooms, 0.9, price=price, epsilon=0) for price in (1e-5, 1e-2))
    assert len(dear.stops) < len(cheap.stops)
    assert dear.ending == "price"
    assert plan_with_misses(rooms, 0.9, price=1).stops == ()


@settings(max_examples=30, deadline=None)
@given(st.lists(SHARE, min_size=1, max_size=6), SHARE, st.floats(0, 1))
def test_probabilities_of_a_plan_add_up(p: list[float], detection: float, rho: float) -> None:
    plan = plan_with_misses(row_of_rooms(p, "any"), detection, rho=rho, most=30)
    anywhere = 1 - np.prod(1 - np.array(p))
    assert len(plan.stops) <= 30
    if plan.stops:
        assert plan.found + plan.stops[-1].left == pytest.approx(anywhere)
    assert all(a.seconds < b.seconds for a, b in itertools.pairwise(plan.stops))


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(OrderingError, match="cannot happen"):
        update_after_miss([1.0, 0.0], 0, 1.0)
    with pytest.raises(OrderingError, match="place must be 0 to 1"):
        update_after_miss([0.5, 0.5], 2, 0.5)
    with pytest.raises(OrderingError, match="sum to 1"):
        update_after_miss([0.9, 0.9], 0, 0.5)
    with pytest.raises(OrderingError, match="rho"):
        plan_with_misses(row_of_rooms([0.5]), 0.5, rho=2)
