from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.frames.sighting import Sighting
from mapping.reference.object_update import (
    decayed,
    existence,
    mean_position,
    reinforced,
    updated_object,
)
from mapping.reference.settings import ReferenceSettings


def test_first_confidence_is_phi_times_the_score():
    assert reinforced(0.0, 0.5, 0.8, 3.0) == pytest.approx(0.4)


def test_confidence_stops_at_nu():
    assert reinforced(2.9, 0.9, 0.8, 3.0) == 3.0


def test_each_miss_costs_xi():
    assert decayed(1.0, 0.45) == pytest.approx(0.55)


@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=30))
def test_confidence_of_a_seen_object_lies_in_nu(scores):
    confidence = 0.0
    for score in scores:
        confidence = reinforced(confidence, score, 0.8, 3.0)
        assert 0 < confidence <= 3.0
        assert 0 < existence(confidence, 3.0) <= 1.0


@given(st.lists(st.tuples(*[st.floats(-10, 10)] * 3), min_size=1, max_size=20))
def test_iterative_mean_is_the_mean(seen):
    points = np.array(seen)
    mean = points[0]
    for k, point in enumerate(points[1:], start=1):
        mean = mean_position(mean, k, point)
    assert mean == pytest.approx(points.mean(axis=0), abs=1e-9)


@pytest.mark.parametrize(("x", "believed"), [(0.3, 0.1), (5.0, 5.0)])
def test_beyond_the_gate_the_mean_starts_again(make_object, x, believed):
    known = make_object(1, "cup", (0, 0, 1), observations=2)
    seen = updated_object(
        known, Sighting("cup", 0.5, np.array([x, 0, 1])), 9.0, ReferenceSettings()
    )
    np.testing.assert_allclose(seen.p_map, (believed, 0, 1))
    assert (seen.observations, seen.last_seen, seen.confidence > 1.0) == (3, 9.0, True)
