"""Identity between sessions, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from lab.maps.complete_truth import TrueObject
from lab.maps.session_identity import IdentityScore, pooled_identity, session_identity
from lab.maps.truth_matching import MappedObject, TruthMatcher


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
