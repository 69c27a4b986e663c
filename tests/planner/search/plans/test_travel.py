from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.search.plans.thesis_rules import (
    Travel,
    arrival_seconds,
    distances,
    expected_seconds,
    travelled,
)

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
