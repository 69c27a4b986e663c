"""The placement model: monotone in the evidence, calibrated on worlds that are as it says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.knowledge.placement.belief_model import (
    FITTED,
    EvidenceArrays,
    Matrix,
    posterior,
    posterior_belief,
)
from lab.placement.fitting import log_beta_binomial
from lab.placement.scores import brier, calibration_error, log_loss, rooms_visited

COUNT = st.integers(0, 400)


def evidence(shape: tuple[int, int] = (1, 1), **given: float | Matrix) -> EvidenceArrays:
    arrays = {name: np.zeros(shape) for name in EvidenceArrays.__dataclass_fields__}
    arrays |= {name: np.broadcast_to(x, shape) for name, x in given.items()}
    return EvidenceArrays(**{**arrays, "surveys": ()})


def p(**given: float) -> float:
    return float(posterior_belief(evidence(**given), FITTED).mean[0, 0])


counts = st.tuples(COUNT, COUNT).map(lambda pair: (max(pair), min(pair)))


@given(
    st.floats(0, 1),
    st.floats(0, 1e6),
    counts,
    st.floats(0, 1e4),
    st.floats(0, 1e4),
    st.floats(0, 1),
)
def test_a_probability_lies_strictly_between_0_and_1(listed, weight, rooms, w, wo, stated):
    given_ = {"listed": listed, "weight": weight, "rooms": rooms[0], "rooms_with": rooms[1]}
    assert 0 < p(**given_, building_with=w, building_without=wo, stated=stated, statements=1) < 1


@given(counts, st.floats(0, 50), st.floats(0.01, 50))
def test_more_evidence_for_raises_it_and_rooms_searched_in_vain_lower_it(rooms, weight, more):
    known = {"rooms": rooms[0], "rooms_with": rooms[1], "weight": weight}
    assert p(weight=weight + more) > p(weight=weight)
    assert p(weight=weight, listed=0.9) >= p(weight=weight, listed=0.2) >= p(weight=weight)
    assert p(**known, building_with=more) > p(**known) > p(**known, building_without=more)
    assert p(**known, building_without=more) > p(**known, building_without=2 * more)
    assert p(**known | {"rooms": rooms[0] + 5}) < p(**known)
    assert p(**known | {"rooms": rooms[0] + 5, "rooms_with": rooms[1] + 5}) > p(**known)


def test_what_is_expected_gives_way_where_counts_contradict_it() -> None:
    with_list = p(listed=0.9, weight=8, rooms=30)
    assert with_list < 0.15 < 0.5 < p(listed=0.9, weight=8)
    assert p(listed=0.9, weight=8, rooms=300) < 0.02


def test_a_persons_number_is_nearly_the_outcome_and_gives_way_to_what_is_seen() -> None:
    said = p(stated=0.6, statements=1)
    assert 0.45 < said < 0.6
    assert p(stated=0.6, statements=1, building_without=20) < 0.2


def test_more_seen_makes_surer() -> None:
    few, many = (
        posterior_belief(evidence(building_with=n, building_without=n), FITTED) for n in (2, 50)
    )
    assert (many.alpha + many.beta > few.alpha + few.beta).all()


def test_the_belief_is_calibrated_in_worlds_drawn_from_the_model() -> None:
    random = np.random.default_rng(5)
    cells = 4000
    prior = posterior_belief(evidence((cells, 1), weight=random.uniform(0, 8, (cells, 1))), FITTED)
    truth = random.beta(prior.alpha, prior.beta)
    seen = random.integers(0, 6, truth.shape)
    hits = random.binomial(seen, truth)
    alpha, beta = prior.alpha + hits, prior.beta + seen - hits
    after = (alpha / (alpha + beta)).ravel()
    held = (random.random(truth.shape) < truth).astype(float).ravel()
    assert calibration_error(after, held, equal_mass=True) < 0.03
    assert log_loss(after, held) < log_loss(prior.mean.ravel(), held)


@given(st.lists(st.floats(0.01, 0.99), min_size=2, max_size=6), st.data())
def test_a_posterior_is_a_distribution_and_unseen_objects_leave_nothing_impossible(row, data):
    n = data.draw(st.integers(0, 5))
    seen = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)), dtype=bool)
    present = np.array([row] * n).reshape(n, len(row))
    found = posterior(present, seen, np.ones(len(row)))
    assert found.sum() == pytest.approx(1)
    assert (found > 0).all()


def test_no_single_object_decides_whatever_the_kind_of_room() -> None:
    present = np.array([[1 - 1e-4, 1e-4]])
    found = posterior(present, np.array([True]), np.array([0.01, 0.99]))
    assert found[0] < 0.25
    assert found[0] > 0.01


def test_scores_of_a_known_case() -> None:
    chance, held = np.array([0.8, 0.8, 0.1, 0.1]), np.array([1.0, 0.0, 0.0, 0.0])
    assert brier(chance, held) == pytest.approx((0.04 + 0.64 + 0.01 + 0.01) / 4)
    assert log_loss(chance, held) == pytest.approx(
        -(np.log(0.8) + np.log(0.2) + 2 * np.log(0.9)) / 4
    )
    assert calibration_error(chance, held) == pytest.approx((2 * 0.3 + 2 * 0.1) / 4)


def test_rooms_visited_takes_ties_at_random() -> None:
    held = np.array([0.0, 0.0, 1.0, 1.0])
    assert rooms_visited(np.array([0.9, 0.8, 0.7, 0.6]), held) == 3
    assert rooms_visited(np.full(4, 0.5), held) == pytest.approx(5 / 3)
    assert rooms_visited(np.array([0.5, 0.9, 0.5, 0.1]), held) == pytest.approx(1 + 3 / 2)


def test_the_chance_of_counts_is_what_drawing_one_by_one_gives() -> None:
    one_by_one = (2 / 5) * (3 / 6) * (3 / 7)  # alpha 2, beta 3: with, with, without
    found = log_beta_binomial(np.array(2.0), np.array(3.0), np.array(3.0), np.array(2.0))
    assert found == pytest.approx(np.log(one_by_one))
