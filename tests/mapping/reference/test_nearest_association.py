from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kg.model.records import ObjectRecord
from mapping.frames.sighting import Sighting
from mapping.reference.object_update import associate, most_confident

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


def test_distance_counts_height(make_object):
    found = associate([sighting("cup", [0, 0, 0.9])], [make_object(1, "cup", [0, 0, 0])], KAPPA)
    assert not found.matched


def test_other_class_at_the_same_spot_is_another_object(make_object):
    found = associate([sighting("cup", [0, 0, 0])], [make_object(1, "chair", [0, 0, 0])], KAPPA)
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
    assert found.new == () and found.dropped == 1


def test_of_new_sightings_near_one_another_the_surest_is_kept():
    weak, strong = sighting("chair", [0, 0, 0], 0.4), sighting("chair", [0.5, 0, 0], 0.8)
    assert most_confident([weak, strong], KAPPA) == (strong,)


def test_new_sightings_far_apart_or_of_other_classes_are_all_kept():
    apart = [
        sighting("chair", [0, 0, 0]),
        sighting("chair", [2, 0, 0]),
        sighting("cup", [0, 0, 0]),
    ]
    assert len(most_confident(apart, KAPPA)) == 3


points = st.tuples(*[st.floats(-2, 2)] * 3)
classes = st.sampled_from(["chair", "cup"])


@given(
    st.lists(st.tuples(classes, points, st.floats(0.01, 1)), max_size=8),
    st.lists(st.tuples(classes, points), max_size=8),
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
    assert len(found.matched) + len(found.new) + found.dropped == len(sightings)
    for iri, match in found.matched.items():
        assert match.category == by_iri[iri].category
        assert np.linalg.norm(match.p_map - by_iri[iri].p_map) < KAPPA


@given(st.lists(st.tuples(classes, points, st.floats(0.01, 1)), max_size=10))
def test_kept_new_sightings_are_apart_and_every_other_has_a_surer_one_nearby(seen):
    sightings = [sighting(c, p, s) for c, p, s in seen]
    kept = most_confident(sightings, KAPPA)

    def near(a, b):
        return a.category == b.category and np.linalg.norm(a.p_map - b.p_map) < KAPPA

    assert not any(near(a, b) for a in kept for b in kept if a is not b)
    for left_out in (s for s in sightings if not any(s is k for k in kept)):
        assert any(near(left_out, k) and k.score >= left_out.score for k in kept)


def test_nothing_seen_changes_nothing(make_object):
    found = associate([], [make_object(1, "chair", [0, 0, 0])], KAPPA)
    assert (dict(found.matched), found.new, found.dropped) == ({}, (), 0)
    assert most_confident([], KAPPA) == ()
