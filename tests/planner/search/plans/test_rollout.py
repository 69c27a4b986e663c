"""Rollouts of sequences of views: times, ways and probabilities, leg by leg."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.serving.opening import in_memory_map
from planner.search.plans.rollout import PlanEvaluator
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import _begin
from tests.planner.flat import fill

SEEDS = st.integers(0, 2**32 - 1)
BEFORE = 7.5  # [s] of the robot's way until its plan begins


@pytest.fixture(scope="module")
def evaluator() -> PlanEvaluator:
    state = build_search(fill(in_memory_map(title="flat")), ["cup", "apple"])
    assert state is not None
    _, at, _ = _begin(state, (6.0, 1.0), 0.0)
    return PlanEvaluator(state, at, BEFORE)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(1, 6), st.integers(0, 6))
def test_a_rollout_is_the_sum_of_its_legs(evaluator: PlanEvaluator, seed, count, same) -> None:
    state, rng = evaluator.state, np.random.default_rng(seed)
    views = [int(one) for one in rng.permutation(len(state.views.viewpoint))[:count]]
    rollout = evaluator.play(views)
    at, arrival, metres = evaluator.at, BEFORE, 0.0
    for n, view in enumerate(views):
        arrival += evaluator.cost(at, view)
        metres += float(state.next_best_view.metres_to(at)[state.views.viewpoint[view]])
        assert (rollout.arrivals[n], rollout.metres[n]) == pytest.approx((arrival, metres))
        assert rollout.robots[n] == at
        at = state.next_best_view.after(at, view)
    assert (rollout.gains >= -1e-12).all() and (rollout.found <= 1).all()

    others = [int(one) for one in rng.permutation(len(state.views.viewpoint))[:count]]
    begun = [*views[:same], *others]
    resumed, fresh = evaluator.play(begun, rollout), evaluator.play(begun)
    for name in ("arrivals", "metres", "found", "unseen", "searched"):
        np.testing.assert_allclose(getattr(resumed, name), getattr(fresh, name), err_msg=name)
    assert resumed.robots == fresh.robots
