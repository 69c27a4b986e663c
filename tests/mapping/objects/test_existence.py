"""Existence: evidence of correlated views, and probabilities of categories."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.objects.existence import (
    CategoryEvidence,
    category_probabilities,
    logit,
    strength,
    visibility,
)

odds = st.floats(-30, 30, allow_nan=False)
scores = st.floats(0, 1)


def existence(*hits: float, missed: float = 0.0, size: float = 0.0) -> float:
    """Existence after hits of these scores, each from a viewpoint of its own."""
    held = CategoryEvidence(sum(map(strength, hits)), float(len(hits)))
    return 1 / (1 + math.exp(-held.log_odds(len(hits) + missed, size)))


@given(st.floats(0, 1))
def test_the_log_odds_of_a_probability_are_its_own_within_bounds(p):
    assert 1 / (1 + math.exp(-logit(p))) == pytest.approx(min(max(p, 0.005), 0.995))


@given(scores, scores)
def test_a_higher_score_says_no_less(one, other):
    low, high = sorted((one, other))
    assert strength(low) <= strength(high)


@given(scores)
def test_one_look_never_makes_it_sure(score):
    assert existence(score) < 0.85


@given(st.lists(scores, min_size=1, max_size=20), st.floats(0.05, 1))
def test_every_hit_speaks_for_it_and_every_miss_against_it(hits, another):
    assert existence(*hits, another) > existence(*hits)
    assert existence(*hits, missed=1) < existence(*hits)


def test_ten_good_looks_make_it_near_certain_and_ten_faint_ones_do_not():
    assert existence(*[0.8] * 10) > 0.95
    assert existence(*[0.22] * 10) < 0.75


def test_what_is_larger_than_things_of_its_name_is_less_likely():
    assert existence(0.6, 0.6, size=-2.0) < 0.6 * existence(0.6, 0.6)


def test_a_false_detection_that_is_repeated_from_one_spot_stays_below_ten_looks_around():
    """Looks from one viewpoint count 1 / n."""
    weight = sum(1 / n for n in range(1, 1001))
    repeated = CategoryEvidence(weight * strength(0.3), weight)
    assert repeated.log_odds(weight, 0.0) < CategoryEvidence(10 * strength(0.5), 10.0).log_odds(
        10.0, 0.0
    )


@given(st.floats(1e-3, 2), st.floats(1e-3, 2))
def test_a_miss_of_a_thing_that_looks_larger_says_more(one, other):
    small, large = sorted((one, other))
    assert 0 <= visibility(small) <= visibility(large) <= 1


@given(st.floats(-3.5, 20), st.floats(-4, 0))
def test_evidence_of_given_log_odds_has_them(log_odds, size):
    held = CategoryEvidence()
    held.set_log_odds(log_odds, size)
    assert held.strength >= 0
    assert held.log_odds(0.0, size) >= log_odds - 1e-9
    if held.strength > 0:
        assert held.log_odds(0.0, size) == pytest.approx(log_odds)


@given(st.lists(scores, max_size=5), st.lists(scores, max_size=5))
def test_merged_evidence_is_that_of_all_looks(one, other):
    merged = CategoryEvidence(sum(map(strength, one)), len(one))
    merged.merge(CategoryEvidence(sum(map(strength, other)), len(other)))
    assert merged.looks == len(one) + len(other)
    assert merged.strength == pytest.approx(sum(map(strength, [*one, *other])))


@given(st.dictionaries(st.text(max_size=3), odds, max_size=6))
def test_probabilities_leave_room_for_nothing_being_there(log_odds):
    found = category_probabilities(log_odds)
    assert found.keys() == log_odds.keys()
    assert all(0 <= share <= 1 for share in found.values())
    assert sum(found.values()) <= 1
    if max(log_odds.values(), default=0.0) < 20:
        assert sum(found.values()) < 1


@given(odds)
def test_a_single_category_is_as_probable_as_its_odds_say(one):
    assert category_probabilities({"cup": one})["cup"] == pytest.approx(1 / (1 + math.exp(-one)))


def test_equal_categories_share_what_is_sure():
    found = category_probabilities({"tv": 12.0, "laptop": 12.0})
    assert found["tv"] == found["laptop"] == pytest.approx(0.5, abs=1e-3)


def test_no_category_has_no_probability():
    assert category_probabilities({}) == {}


@given(st.floats(0, 1))
def test_log_odds_of_a_probability_are_finite_and_lead_back_to_it(probability):
    kept = min(max(probability, 0.005), 0.995)
    assert 1 / (1 + math.exp(-logit(probability))) == pytest.approx(kept)
