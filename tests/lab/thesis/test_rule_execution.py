"""Plans carried out against a hidden truth cost what they should."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lab.thesis.rule_execution import follow, in_place, within
from planner.search.goals.search_goals import Goal
from planner.search.plans.thesis_rules import Travel, in_order, nearest_first


def goal(name: str, x: float, y: float, probability: float = 0.5) -> Goal:
    return Goal(name, "known", name, np.array([x, y], dtype=np.float64), probability, f"{name}!")


coordinate = st.floats(-30, 30, allow_nan=False)
goals = st.lists(st.tuples(coordinate, coordinate, st.floats(0.01, 1)), min_size=1, max_size=8).map(
    lambda rows: [goal(f"o{i}", x, y, p) for i, (x, y, p) in enumerate(rows)]
)
start = st.tuples(coordinate, coordinate)


@given(start, goals, st.integers(0, 2**32 - 1))
def test_a_search_costs_what_its_first_hit_costs(begin, given_goals, seed):
    plan = in_order(begin, given_goals)
    present = np.random.default_rng(seed).random(len(given_goals)) < 0.5
    shown = {g.iri for g, here in zip(given_goals, present, strict=True) if here}
    outcome = follow(plan, lambda g: g.iri in shown)
    if shown:
        first = int(np.argmax(present))
        assert outcome.explored == first + 1
        assert outcome.seconds == plan.steps[first].seconds
    else:
        assert outcome.found is None
        assert outcome.explored == len(given_goals)


def test_what_is_hidden_is_found_from_the_first_goal_within_reach() -> None:
    plan = nearest_first((0, 0), [goal("near", 2, 0), goal("far", 9, 0)], travel=Travel(1.0, 5.0))
    outcome = follow(plan, within((8, 2), reach=2.8))
    assert outcome.found is not None
    assert (outcome.found.iri, outcome.explored, outcome.distance, outcome.seconds) == (
        "far",
        2,
        9.0,
        19.0,
    )
    assert follow(plan, within((8, 3), reach=2.8)).found is None


def test_a_search_in_vain_costs_every_stop_and_no_goals_cost_nothing() -> None:
    plan = nearest_first((0, 0), [goal("a", 3, 4)], travel=Travel(1.0, 5.0))
    assert follow(plan, in_place("elsewhere")).seconds == 10.0
    nothing = follow(nearest_first((0, 0), []), in_place("elsewhere"))
    assert (nothing.found, nothing.explored, nothing.seconds) == (None, 0, 0.0)
