"""Existence: evidence of correlated views, and probabilities of categories."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.objects.existence import ViewEvidence, category_probabilities, logit

odds = st.floats(-30, 30, allow_nan=False)


def seen(times: int, ratio: float, weight: float = 1.0) -> ViewEvidence:
    evidence = ViewEvidence()
    for _ in range(times):
        evidence.add(ratio, weight)
    return evidence


def test_one_view_counts_in_full():
    assert seen(1, 1.5).saturated(0.1) == pytest.approx(1.5)


@given(st.integers(1, 500), st.floats(0.01, 0.5))
def test_a_label_that_repeats_itself_saturates(times, correlation):
    total = seen(times, 2.0).saturated(correlation)
    assert total <= seen(times + 1, 2.0).saturated(correlation) + 1e-9
    assert total < 2.0 / correlation + 1e-9


def test_views_without_correlation_add_up():
    assert seen(4, 1.5).saturated(0.0) == pytest.approx(6.0)


def test_views_from_where_it_was_seen_before_count_by_their_weight():
    held = seen(1, 2.0)
    held.add(2.0, 0.15)
    assert (held.views, held.total) == (pytest.approx(1.15), pytest.approx(2.3))


@given(st.integers(0, 20), st.integers(0, 20), odds, odds)
def test_merged_evidence_is_that_of_all_views(one, other, ratio, other_ratio):
    merged = seen(one, ratio)
    merged.merge(seen(other, other_ratio))
    assert merged.views == one + other
    assert merged.total == pytest.approx(one * ratio + other * other_ratio, abs=1e-6)


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
