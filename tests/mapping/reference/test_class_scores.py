from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.reference.class_scores import Truth, match, score_map

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


def test_empty_map_and_empty_truth_have_nothing_to_share():
    score = score_map([], truth(), IDENTITY)
    assert json.loads(json.dumps(score.to_json()))["recall"] is None
    assert score_map([], truth(("cup", [0, 0, 0])), IDENTITY).recall == 0.0


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
