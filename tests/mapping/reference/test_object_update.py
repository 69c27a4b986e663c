"""The thesis' rules for objects: association, updates and scores."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting
from mapping.reference.belief_filters import mean_update
from mapping.reference.class_scores import Truth, match, score_map
from mapping.reference.object_update import (
    associate,
    existence,
    mean_position,
    most_confident,
    reinforced,
    updated_object,
)
from mapping.reference.settings import ReferenceSettings


def test_confidence_stops_at_nu():
    assert reinforced(2.9, 0.9, 0.8, 3.0) == 3.0


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


CATEGORIES = ("bar", "kitchen", "office", "patio")
scores = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4).map(
    lambda v: {c: x / (sum(v) or 1.0) for c, x in zip(CATEGORIES, v, strict=True)}
)


@given(st.lists(scores, min_size=1, max_size=12))
def test_mean_filter_is_the_mean_over_all_views(views):
    belief: dict[str, float] = {}
    for k, view in enumerate(views):
        belief = mean_update(belief, k, view)
    for category in CATEGORIES:
        mean = sum(view[category] for view in views) / len(views)
        assert belief[category] == pytest.approx(mean, abs=1e-12)


IDENTITY = np.eye(4)


def truth(*objects, complete=("cup",)):
    labels = tuple(label for label, _ in objects)
    positions = np.array([p for _, p in objects], dtype=float).reshape(-1, 3)
    return Truth(tuple(str(n) for n in range(len(objects))), labels, positions, complete)


def mapped(*objects):
    return [(label, np.array(p, dtype=float)) for label, p in objects]


def test_perfect_map():
    true = truth(("cup", [0, 0, 0]), ("chair", [2, 0, 0]))
    score = score_map(mapped(("cup", [0.1, 0, 0]), ("chair", [2, 0.3, 0])), true, IDENTITY)
    assert (score.precision, score.recall, score.duplicates) == (1.0, 1.0, 0)
    assert score.position_error_median == pytest.approx(0.2)


def test_second_object_at_a_matched_one_is_a_duplicate():
    true = truth(("cup", [0, 0, 0]))
    objects = mapped(("cup", [0.1, 0, 0]), ("cup", [0.3, 0, 0]), ("cup", [3, 0, 0]))
    score = score_map(objects, true, IDENTITY)
    assert score.precision == pytest.approx(1 / 3)
    assert score.duplicates == 1
    assert score.position_error_median == pytest.approx(0.1)


def test_precision_counts_only_classes_whose_truth_is_complete():
    true = truth(("cup", [0, 0, 0]), ("book", [1, 0, 0]))
    objects = mapped(("cup", [0, 0, 0]), ("book", [9, 0, 0]), ("oven", [9, 0, 0]))
    score = score_map(objects, true, IDENTITY)
    assert score.precision == 1.0
    assert score.recall == 0.5
    assert score.per_class["oven"].mapped == 1


def test_wrong_class_and_too_far_do_not_match():
    true = truth(("cup", [0, 0, 0]), ("chair", [2, 0, 0]))
    score = score_map(mapped(("bowl", [0, 0, 0]), ("chair", [2.6, 0, 0])), true, IDENTITY)
    assert score.recall == 0.0
    assert score.precision is None and score.position_error_median is None


def test_large_things_may_be_further_off():
    true = truth(("dining table", [0, 0, 0]), ("chair", [5, 0, 0]))
    score = score_map(mapped(("dining table", [0.9, 0, 0]), ("chair", [5.9, 0, 0])), true, IDENTITY)
    assert score.per_class["dining table"].matched == 1
    assert score.per_class["chair"].matched == 0


def test_truth_is_taken_into_the_map():
    T = np.eye(4)
    T[:3, 3] = [10, 0, 1]
    score = score_map(mapped(("cup", [10, 0, 1])), truth(("cup", [0, 0, 0])), T)
    assert score.recall == 1.0


points = st.lists(st.tuples(*[st.floats(-1, 1)] * 3), max_size=7).map(
    lambda p: np.array(p, dtype=float).reshape(-1, 3)
)


@given(points, points)
def test_matching_is_one_to_one_within_the_limit_and_leaves_no_pair(ours, true):
    pairs = match(ours, true, 0.5)
    assert len({m for m, _, _ in pairs}) == len({t for _, t, _ in pairs}) == len(pairs)
    assert all(d <= 0.5 for _, _, d in pairs)
    for m in set(range(len(ours))) - {m for m, _, _ in pairs}:
        for t in set(range(len(true))) - {t for _, t, _ in pairs}:
            assert np.linalg.norm(ours[m] - true[t]) > 0.5


KAPPA = 0.75


def sighting(category, p_map, score=0.5):
    return Sighting(category, score, np.array(p_map, dtype=float), 2.0, (0, 0, 1, 1))


def test_sighting_within_kappa_of_its_class_is_that_object(make_object):
    found = associate(
        [sighting("chair", [0.74, 0, 0])], [make_object(1, "chair", [0, 0, 0])], KAPPA
    )
    assert list(found.matched) == ["https://example.org/object/1"]
    assert found.new == ()


def test_kappa_itself_is_too_far(make_object):
    found = associate(
        [sighting("chair", [0.75, 0, 0])], [make_object(1, "chair", [0, 0, 0])], KAPPA
    )
    assert not found.matched
    assert len(found.new) == 1


def test_sighting_between_two_objects_is_the_nearer(make_object):
    objects = [make_object(1, "chair", [0, 0, 0]), make_object(2, "chair", [1, 0, 0])]
    found = associate([sighting("chair", [0.6, 0, 0])], objects, KAPPA)
    assert list(found.matched) == ["https://example.org/object/2"]


def test_of_several_sightings_of_one_object_the_nearest_counts_and_the_others_are_dropped(
    make_object,
):
    near, far = sighting("chair", [0.1, 0, 0], 0.3), sighting("chair", [0.5, 0, 0], 0.9)
    found = associate([far, near], [make_object(1, "chair", [0, 0, 0])], KAPPA)
    assert found.matched["https://example.org/object/1"] is near
    assert found.new == ()


spots = st.tuples(*[st.floats(-2, 2)] * 3)
classes = st.sampled_from(["chair", "cup"])


@given(
    st.lists(st.tuples(classes, spots, st.floats(0.01, 1)), max_size=8),
    st.lists(st.tuples(classes, spots), max_size=8),
)
def test_no_two_sightings_match_one_object_and_none_gets_lost(seen, known):
    sightings = [sighting(c, p, s) for c, p, s in seen]
    objects = [
        ObjectRecord(str(n), c, np.array(p), 1.0, 0.3, 1, 0.0, 0.0)
        for n, (c, p) in enumerate(known)
    ]
    found = associate(sightings, objects, KAPPA)
    by_iri = {o.iri: o for o in objects}
    assert len({id(s) for s in found.matched.values()}) == len(found.matched)
    assert len(found.matched) + len(found.new) <= len(sightings)
    for iri, one in found.matched.items():
        assert one.category == by_iri[iri].category
        assert np.linalg.norm(one.p_map - by_iri[iri].p_map) < KAPPA


@given(st.lists(st.tuples(classes, spots, st.floats(0.01, 1)), max_size=10))
def test_kept_new_sightings_are_apart_and_every_other_has_a_surer_one_nearby(seen):
    sightings = [sighting(c, p, s) for c, p, s in seen]
    kept = most_confident(sightings, KAPPA)

    def near(a, b):
        return a.category == b.category and np.linalg.norm(a.p_map - b.p_map) < KAPPA

    assert not any(near(a, b) for a in kept for b in kept if a is not b)
    for left_out in (s for s in sightings if not any(s is k for k in kept)):
        assert any(near(left_out, k) and k.score >= left_out.score for k in kept)
