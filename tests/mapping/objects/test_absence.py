"""Absence: what hits, misses and rays through a thing's spot say about whether it left."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.objects.absence import Absence
from mapping.persistence import departed, holds, learned_half_life, listed_half_life

DAY = 86400.0


def seen(hits: int, misses: int = 0) -> Absence:
    absence = Absence()
    for _ in range(misses):
        absence.miss(1.0, 0.6)
    for _ in range(hits):
        absence.hit(1.0)
    return absence


def test_without_a_view_nothing_is_known_to_have_left():
    assert seen(3).probability(0.2) == 0.0


def test_misses_of_what_is_seldom_detected_say_less():
    often, seldom = seen(8), seen(4, misses=8)
    for absence in (often, seldom):
        for _ in range(4):
            absence.miss(1.0, 0.6)
    assert often.probability(0.1) > 0.5 > seldom.probability(0.1)


def test_a_run_of_misses_saturates():
    absence = seen(2)
    steps = []
    for _ in range(10):
        before = absence.log_ratio
        absence.miss(1.0, 0.6)
        steps.append(absence.log_ratio - before)
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] < 0.3 < 0.6 < steps[0]


@given(st.integers(0, 500), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_however_often_it_was_detected_one_miss_at_most_doubles_the_odds_that_it_left(
    hits: int, recall: float, prior: float
):
    absence = seen(hits)
    absence.miss(1.0, recall)
    left = absence.probability(prior)
    assert 1 < left / (1 - left) / (prior / (1 - prior)) <= 2 + 1e-9


def test_a_hit_ends_the_doubt():
    absence = seen(3)
    absence.empty(1.0, 3.0)
    absence.miss(1.0, 0.8)
    absence.hit(1.0)
    assert absence.probability(0.2) == 0.0


def test_a_merged_thing_was_seen_when_either_was():
    lost, just_seen, doubted = seen(4), seen(2, misses=1), seen(3)
    for _ in range(5):
        lost.miss(1.0, 0.6)
    doubted.miss(1.0, 0.6)
    assert lost.probability(0.2) > doubted.probability(0.2) > 0
    lower, run = doubted.log_ratio, doubted.run
    doubted.merge(lost)
    assert (doubted.log_ratio, doubted.run) == (lower, run)
    lost.merge(just_seen)
    assert lost.probability(0.2) == 0.0
    assert lost == Absence(hits=6.0, misses=1.0)  # all views of both count from now on


def test_what_is_carried_leaves_sooner_than_what_is_fixed():
    cup, sink = listed_half_life("cup"), listed_half_life("sink")
    assert departed(sink, 0) < departed(cup, 0) == pytest.approx(0.02)
    assert departed(sink, DAY) < 0.01 < 0.1 < departed(cup, DAY) < 0.2


@given(st.floats(1, 1e9), st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_what_was_just_seen_holds_and_half_of_it_after_a_half_life(half_life, age, more):
    assert holds(half_life, half_life) == 0.5
    assert holds(half_life, min(age, 0.0)) == 1.0  # seen later than now, by another clock
    assert 0.0 <= holds(half_life, age + more) <= holds(half_life, age) <= 1.0


@given(st.floats(1, 1e7), st.lists(st.floats(-1e9, 1e9), max_size=5))
def test_a_stay_counts_up_to_twice_the_listed_half_life(listed, stays):
    learned = learned_half_life(listed, stays)
    assert listed * (1 - 1e-9) <= learned
    assert learned <= listed * (1 + 2 * math.log(2) * len(stays)) * (1 + 1e-9)
    assert learned == pytest.approx(learned_half_life(listed, [min(s, 2 * listed) for s in stays]))
    assert learned_half_life(listed, [listed]) == pytest.approx(listed * (1 + math.log(2)))
