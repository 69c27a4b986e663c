"""Detector rates: what hits and misses say, by score and size."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.objects.detector_rates import UNKNOWN, DetectorRates, rates_of
from perception.inference.model_zoo import bundled_pair, cards

share = st.floats(0, 3)
score = st.floats(0, 1)
MEASURED = [card.name for card in cards() if card.rates is not None]
every_card = pytest.mark.parametrize("name", [*MEASURED, "a network without a card"])


@every_card
@given(score=score, size=share)
def test_a_hit_never_says_less_than_a_miss(name, score, size):
    rates = rates_of(name)
    assert rates.hit(score, size) >= rates.miss(size)


@every_card
@given(one=score, other=score, size=share)
def test_a_surer_hit_says_no_less(name, one, other, size):
    rates, (low, high) = rates_of(name), sorted((one, other))
    assert rates.hit(low, size) <= rates.hit(high, size)


@every_card
@given(one=share, other=share)
def test_a_miss_of_a_larger_thing_says_more_against_it(name, one, other):
    rates, (small, large) = rates_of(name), sorted((one, other))
    assert rates.miss(large) <= rates.miss(small) <= 0


@every_card
def test_a_sure_hit_speaks_for_a_thing_and_a_miss_of_a_large_one_against_it(name):
    rates = rates_of(name)
    assert rates.hit(0.9, 0.3) > 1
    assert rates.miss(0.5) < -0.5
    assert rates.miss(0.0) == 0, "what cannot be seen is not missed"


def test_rates_come_from_the_model_card():
    card = next(card for card in cards() if card.rates is not None)
    assert rates_of(card.name) == DetectorRates(**card.rates)
    assert rates_of("a network without a card") == UNKNOWN


def test_the_bundled_detectors_are_measured():
    assert set(bundled_pair()) <= set(MEASURED)
