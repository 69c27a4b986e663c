"""Average precision and best F1 over existence, each worked out by hand."""

import numpy as np
import pytest

from lab.maps.complete_truth import TrueObject
from lab.maps.existence_curve import existence_curve, pooled_curve
from lab.maps.truth_matching import MappedObject, TruthMatcher


def cups(*xs, **more):
    """Matcher of one true cup at each x [m] on a line."""
    truth = [TrueObject(f"cup {x}", "cup", np.array([x, 0.0, 0.0]), **more) for x in xs]
    return TruthMatcher(truth, np.eye(4))


def cup(x, existence):
    return MappedObject("cup", np.array([x, 0.0, 0.0]), existence)


def test_false_objects_above_true_ones_cost_precision():
    # recall 1/4 at 1, 2/4 at 2/3, 3/4 at 3/5; the fourth is never found
    objects = [cup(0, 0.9), cup(50, 0.8), cup(10, 0.7), cup(60, 0.6), cup(20, 0.5)]
    curve = existence_curve(objects, cups(0, 10, 20, 30))
    assert curve.average_precision == pytest.approx((1 + 2 / 3 + 3 / 5) / 4)
    assert curve.best_f1 == pytest.approx(2 * 3 / (4 + 5))


def test_a_recall_counts_with_the_best_precision_of_higher_ones():
    # precision 0, 1/2, 2/3: the envelope is 2/3 everywhere
    curve = existence_curve([cup(50, 0.9), cup(0, 0.8), cup(10, 0.7)], cups(0, 10))
    assert curve.average_precision == pytest.approx(2 / 3)


def test_what_is_below_every_true_object_costs_nothing():
    curve = existence_curve([cup(0, 0.9), cup(50, 0.1), cup(60, 0.1)], cups(0))
    assert (curve.average_precision, curve.best_f1) == (1.0, 1.0)
    assert [(p.matched, p.false) for p in curve.points] == [(1, 0), (1, 2)]


def test_duplicates_are_false_and_ignored_ones_count_neither_way():
    assert existence_curve([cup(0, 0.5), cup(0.1, 0.5)], cups(0)).average_precision == 0.5
    assert existence_curve([cup(0, 0.5)], cups(0, ignore=True)).average_precision is None


def test_an_empty_map_has_no_average_precision_and_an_empty_truth_none():
    empty = existence_curve([], cups(0))
    assert (empty.average_precision, empty.best_f1) == (0.0, 0.0)
    nothing = existence_curve([cup(0, 0.9)], cups())
    assert (nothing.average_precision, nothing.best_f1) == (None, None)


def test_maps_are_pooled_by_their_objects():
    one = existence_curve([cup(0, 0.9)], cups(0))
    other = existence_curve([cup(50, 0.95), cup(0, 0.3)], cups(0))
    # by falling existence: false, right, right
    assert pooled_curve([one, other]).average_precision == pytest.approx(2 / 3)
    assert pooled_curve([one, one]).average_precision == 1.0
