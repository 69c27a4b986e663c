"""Evaluation of maps, and of identity over sessions."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import create_map, in_memory_map, open_map
from lab.maps.complete_truth import TrueObject
from lab.maps.map_evaluation import calibration, coverage, evaluate_map, mapped_objects, pooled
from lab.maps.session_identity import (
    IdentityScore,
    identity_switches,
    pooled_identity,
    session_identity,
)
from lab.maps.truth_matching import MappedObject, TruthMatcher

IDENTITY = np.eye(4)


def cups(*xs, **more):
    """Matcher of one true cup at each x [m] on a line."""
    truth = [TrueObject(f"cup {x}", "cup", np.array([x, 0.0, 0.0]), **more) for x in xs]
    return TruthMatcher(truth, IDENTITY)


def cup(x, existence=1.0, iri="", covariance=None):
    return MappedObject("cup", np.array([x, 0.0, 0.0]), existence, iri, covariance)


def test_calibration_error_by_hand():
    matcher = cups(0, 10, 20)
    objects = [cup(0, 0.95), cup(10, 0.85), cup(30, 0.85), cup(40, 0.15)]
    found = calibration([matcher.match(objects)])
    assert [(b.lower, b.cases, b.predicted, b.true) for b in found.bins] == [
        (0.1, 1, 0.15, 0.0),
        (0.8, 2, 0.85, 0.5),
        (0.9, 1, 0.95, 1.0),
    ]
    assert found.ece == pytest.approx((0.15 + 2 * 0.35 + 0.05) / 4)


def test_calibration_leaves_ignored_objects_out():
    found = calibration([cups(0, ignore=True).match([cup(0, 0.9)])])
    assert (found.cases, found.ece, found.bins) == (0, None, ())


def test_certain_and_impossible_objects_have_a_bin():
    found = calibration([cups(0).match([cup(0, 1.0), cup(9, 0.0)])])
    assert found.ece == 0.0
    assert [(b.lower, b.upper) for b in found.bins] == [(0.0, 0.1), (0.9, 1.0)]


def test_a_second_object_at_a_true_one_is_not_true():
    found = calibration([cups(0).match([cup(0, 0.9), cup(0.1, 0.9)])])
    assert found.bins[0].true == 0.5


def test_coverage_of_gaussian_errors_is_95_percent():
    rng = np.random.default_rng(5)
    truth = [TrueObject(str(i), "cup", np.array([5.0 * i, 0, 0])) for i in range(2000)]
    matcher = TruthMatcher(truth, IDENTITY)
    half = np.array([[0.05, 0, 0], [0.02, 0.03, 0], [0.01, 0, 0.04]])
    objects = [
        MappedObject("cup", t.p_world + half @ rng.normal(size=3), covariance=half @ half.T)
        for t in truth[::2]
    ]
    found = coverage([(matcher.match(objects), matcher)])
    assert found.objects == 1000
    assert found.ellipse == pytest.approx(0.95, abs=0.02)
    assert found.ellipsoid == pytest.approx(0.95, abs=0.02)


def test_coverage_of_objects_without_covariance_is_none():
    matcher = cups(0)
    found = coverage([(matcher.match([cup(0)]), matcher)])
    assert (found.objects, found.ellipse, found.ellipsoid) == (0, None, None)


def test_an_exact_position_lies_in_the_narrowest_ellipse():
    matcher = cups(0)
    found = coverage([(matcher.match([cup(0, covariance=np.zeros((3, 3)))]), matcher)])
    assert (found.ellipse, found.ellipsoid) == (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class RecordWithCovariance(ObjectRecord):
    covariance: np.ndarray | None = None


def test_covariances_of_records_are_used():
    semantic_map = in_memory_map()
    plain = record(semantic_map, 0.1)
    fields = {name: getattr(plain, name) for name in ObjectRecord.__dataclass_fields__}
    matcher = cups(0)
    for deviation, inside in ((0.2, 1.0), (0.02, 0.0)):
        covariance = deviation**2 * np.eye(3)
        told = RecordWithCovariance(**fields | {"covariance": covariance})
        matching = matcher.match(mapped_objects([told], semantic_map.catalogue.label))
        found = coverage([(matching, matcher)])
        assert (found.objects, found.ellipse, found.ellipsoid) == (1, inside, inside)


def switches(*states):
    return identity_switches([[cup(x, e, iri) for iri, x, e in state] for state in states], cups(0))


def test_an_object_that_takes_the_place_of_another_is_a_switch():
    assert switches([("a", 0, 1)], [("b", 0, 1)], [("a", 0, 1)]) == 2


def test_an_object_that_comes_back_is_no_switch():
    assert switches([("a", 0, 1)], [], [("a", 0, 0.4)], [("a", 0.1, 1)]) == 0


def test_a_nearer_duplicate_does_not_take_over():
    assert switches([("a", 0.3, 1)], [("a", 0.3, 1), ("b", 0, 1)]) == 0
    assert switches([("a", 0.3, 1)], [("a", 0.6, 1), ("b", 0, 1)]) == 1
    assert switches([("a", 0.3, 1)], [("a", 0.3, 0.4), ("b", 0, 1)]) == 1


def record(semantic_map, x, **more):
    return ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find("cup", "object").iri,
        p_map=np.array([x, 0.0, 0.0]),
        confidence=2.0,
        existence=0.9,
        observations=4,
        first_seen=0.0,
        last_seen=10.0,
        **more,
    )


def replaced(semantic_map):
    """A cup that moves a little, vanishes, and is mapped anew."""
    first = record(semantic_map, 0.0)
    semantic_map.apply(MapUpdate(objects=(first,)))
    semantic_map.apply(MapUpdate(objects=(replace(first, p_map=np.array([0.1, 0, 0])),)))
    semantic_map.apply(MapUpdate(removed=(first.iri,)))
    semantic_map.apply(MapUpdate(objects=(record(semantic_map, 0.2), record(semantic_map, 9.0))))


def test_the_past_of_a_map_tells_its_switches(tmp_path):
    with create_map(tmp_path / "a.map") as semantic_map:
        replaced(semantic_map)
    with open_map(tmp_path / "a.map", read_only=True) as semantic_map:
        evaluation = evaluate_map(semantic_map, cups(0))
    scores = evaluation.scores()
    assert scores.switches == 1
    assert (scores.thresholds[0].matched, scores.thresholds[0].ghosts) == (1, 1)
    assert scores.calibration.ece == pytest.approx(0.4)


def test_a_map_whose_past_was_dropped_has_no_count_of_switches(tmp_path):
    with create_map(tmp_path / "a.map") as semantic_map:
        replaced(semantic_map)
        semantic_map.history.compact(0)
        evaluation = evaluate_map(semantic_map, cups(0))
    assert evaluation.scores().switches is None
    assert pooled([evaluation]).switches is None


def test_pooled_scores_count_the_objects_of_all_maps():
    semantic_map = in_memory_map()
    replaced(semantic_map)
    one, other = evaluate_map(semantic_map, cups(0)), evaluate_map(semantic_map, cups(50, 9))
    both = pooled([one, other])
    alone = one.scores().thresholds[2], other.scores().thresholds[2]
    assert (both.thresholds[2].true, both.thresholds[2].matched) == (3, 2)
    assert both.thresholds[2].mapped == alone[0].mapped + alone[1].mapped
    assert both.calibration.cases == 4


def session(truth, mapped):
    """Matching of objects IRI -> x [m] with things name -> (x, moved)."""
    things = [
        TrueObject(name, "cup", np.array([x, 0.0, 0.0]), moved=moved)
        for name, (x, moved) in truth.items()
    ]
    matcher = TruthMatcher(things, np.eye(4))
    objects = [MappedObject("cup", np.array([x, 0.0, 0.0]), 1.0, i) for i, x in mapped.items()]
    return matcher.match(objects), matcher


BEFORE = session(
    {"a": (0, False), "b": (5, False), "c": (10, False), "d": (15, False)},
    {"1": 0, "2": 5, "3": 10, "4": 15},
)


def test_a_thing_that_moved_is_right_under_its_iri():
    after = session(
        {"a": (0, False), "b": (50, True), "c": (60, True), "e": (70, False)},
        {"1": 0, "2": 50, "3": 70, "5": 60},
    )
    found = session_identity(BEFORE, after)
    assert found.everything == IdentityScore(things=3, objects=3, right=2)
    assert (found.everything.recall, found.everything.wrong) == (pytest.approx(2 / 3), 1)
    assert found.moved == IdentityScore(things=2, objects=2, right=1)
    assert found.moved.f1 == 0.5


def test_a_thing_missed_in_a_session_counts_against_recall_alone():
    after = session({"a": (0, False), "b": (5, False)}, {"1": 0})
    found = session_identity(BEFORE, after).everything
    assert (found.recall, found.precision) == (0.5, 1.0)


def test_pooled_counts_add_up_and_nothing_has_no_score():
    after = session({"a": (0, False)}, {"1": 0})
    one = session_identity(BEFORE, after)
    assert pooled_identity([one, one]).everything == IdentityScore(2, 2, 2)
    assert pooled_identity([]).everything.f1 is None
