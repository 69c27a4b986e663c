from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.reference.belief_filters import bayes_update, mean_update, with_prior

CATEGORIES = ("bar", "kitchen", "office", "patio")
scores = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4).map(
    lambda v: {c: x / (sum(v) or 1.0) for c, x in zip(CATEGORIES, v, strict=True)}
)


def test_mean_of_two_views():
    belief = mean_update({"kitchen": 0.8, "bar": 0.2}, 1, {"kitchen": 0.4, "office": 0.6})
    assert belief == pytest.approx({"kitchen": 0.6, "bar": 0.1, "office": 0.3})


@given(st.lists(scores, min_size=1, max_size=12))
def test_mean_filter_is_the_mean_over_all_views(views):
    belief: dict[str, float] = {}
    for k, view in enumerate(views):
        belief = mean_update(belief, k, view)
    for category in CATEGORIES:
        mean = sum(view[category] for view in views) / len(views)
        assert belief[category] == pytest.approx(mean, abs=1e-12)


def test_bayes_is_the_normalised_product():
    prior = {"kitchen": 0.5, "bar": 0.25, "office": 0.25}
    belief = bayes_update(prior, {"kitchen": 0.2, "bar": 0.8}, ["kitchen", "bar", "office"], 0.0)
    assert belief == pytest.approx({"kitchen": 1 / 3, "bar": 2 / 3, "office": 0.0})


def test_first_bayes_view_starts_from_a_uniform_prior():
    belief = bayes_update({}, {"kitchen": 0.75, "bar": 0.25}, ["kitchen", "bar"], 1e-3)
    assert belief == pytest.approx({"kitchen": 0.75, "bar": 0.25})


@given(scores, scores)
def test_bayes_keeps_a_distribution_in_which_nothing_is_impossible(first, second):
    belief = bayes_update(bayes_update({}, first, CATEGORIES, 1e-3), second, CATEGORIES, 1e-3)
    assert sum(belief.values()) == pytest.approx(1.0)
    assert min(belief.values()) > 0


def test_bayes_changes_its_mind_faster_than_the_mean():
    # why the thesis dropped it: a few views turn it round
    kitchen, bar = {"kitchen": 0.7, "bar": 0.3}, {"kitchen": 0.1, "bar": 0.9}
    mean: dict[str, float] = {}
    bayes: dict[str, float] = {}
    for k, view in enumerate([kitchen] * 4 + [bar] * 2):
        mean = mean_update(mean, k, view)
        bayes = bayes_update(bayes, view, ["kitchen", "bar"], 1e-3)
    assert mean["kitchen"] == pytest.approx(0.5)
    assert bayes["bar"] > 0.6


def test_prior_knowledge_leaves_out_the_rest_and_renormalises():
    given_scores = {"kitchen": 0.3, "bar": 0.1, "patio": 0.6}
    assert with_prior(given_scores, ["kitchen", "bar"]) == pytest.approx(
        {"kitchen": 0.75, "bar": 0.25}
    )


def test_view_of_nothing_allowed_says_nothing():
    assert with_prior({"patio": 1.0}, ["kitchen"]) is None
    assert with_prior({"kitchen": 0.0}, ["kitchen"]) is None
