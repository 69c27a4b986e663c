"""Data association of one frame's sightings with tracks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.objects.association import associate, shared_footprint
from mapping.objects.settings import ObjectSettings

SETTINGS = ObjectSettings()
side = st.floats(0.05, 3)
corner = st.floats(-3, 3)
boxes = st.tuples(corner, corner, corner, side, side, side).map(
    lambda b: (np.array(b[:3]), np.array(b[:3]) + np.array(b[3:]))
)


def nothing(track):
    return None, None


def found(sightings, tracks, asserted=nothing):
    return associate(sightings, tracks, asserted, SETTINGS)


def test_two_cups_side_by_side_stay_with_their_own_tracks(make_sighting, make_track):
    tracks = [make_track("cup", (2, y, 1)) for y in (0.0, 0.3)]
    sightings = [make_sighting({"cup": 0.7}, (2.05, y, 1)) for y in (0.33, -0.02)]
    assert found(sightings, tracks) == {0: 1, 1: 0}


def test_two_cups_where_one_was_known_leave_one_over(make_sighting, make_track):
    sightings = [make_sighting({"cup": 0.7}, (2, y, 1)) for y in (0.3, 0.0)]
    assert found(sightings, [make_track("cup", (2, 0, 1))]) == {1: 0}


def test_gates_grow_with_size(make_sighting, make_track):
    shift = 0.45
    cup = make_sighting({"cup": 0.7}, (2, shift, 1))
    assert found([cup], [make_track("cup", (2, 0, 1))]) == {}
    table = make_sighting({"dining table": 0.7}, (2, shift, 1), size=1.2)
    assert found([table], [make_track("dining table", (2, 0, 1), size=1.4)]) == {0: 0}


def test_parts_of_one_table_are_one_by_their_footprints(make_sighting, make_track):
    track = make_track("dining table", (2, 0, 0.7), size=2.4, sides=(2.4, 1.0, 0.1))
    part = make_sighting({"dining table": 0.7}, (3.1, 0.0, 0.7), size=0.5, sides=(0.5, 0.8, 0.1))
    aside = make_sighting({"dining table": 0.7}, (3.1, 2.0, 0.7), size=0.5, sides=(0.5, 0.8, 0.1))
    assert found([part, aside], [track]) == {0: 0}


def test_another_name_for_what_is_in_the_same_spot_is_the_same_thing(make_sighting, make_track):
    tv = make_track("tv", (2, 0, 1), size=0.5)
    assert found([make_sighting({"laptop": 0.7}, (2.05, 0, 1), size=0.45)], [tv]) == {0: 0}
    assert found([make_sighting({"laptop": 0.7}, (2.5, 0, 1), size=0.45)], [tv]) == {}
    assert found([make_sighting({"cup": 0.7}, (2.05, 0, 1), size=0.1)], [tv]) == {}, "in front"


def test_a_thing_of_the_same_name_is_preferred(make_sighting, make_track):
    tracks = [make_track("cup", (2, 0, 1)), make_track("bottle", (2, 0.06, 1))]
    assert found([make_sighting({"bottle": 0.5}, (2, 0.01, 1))], tracks) == {0: 1}


def test_a_small_thing_last_seen_long_ago_is_taken_only_for_what_is_near_its_spot(
    make_sighting, make_track
):
    def pairs(shift, *, stale, name="cup", size=0.1):
        track = make_track("cup", (2, 0, 1), size=size)
        track.stale = stale
        return found([make_sighting({name: 0.7}, (2, shift, 1), size=size)], [track])

    taken = {0: 0}
    assert (pairs(0.15, stale=False), pairs(0.15, stale=True)) == (taken, {})
    assert pairs(0.08, stale=True) == taken
    assert pairs(0.15, stale=True, size=0.5) == taken  # large things are seldom replaced
    other = {"name": "bottle"}
    assert (pairs(0.1, stale=False, **other), pairs(0.1, stale=True, **other)) == (taken, {})
    assert pairs(0.05, stale=True, **other) == taken


def test_asserted_position_and_category_are_looked_at_too(make_sighting, make_track):
    track = make_track("cup", (2, 0, 1))

    def asserted(_):
        return np.array([4.0, 2.0, 1.0]), "bowl"

    there = make_sighting({"bowl": 0.7}, (4.1, 2.0, 1))
    assert found([there], [track]) == {}
    assert found([there], [track], asserted) == {0: 0}
    assert found([make_sighting({"bowl": 0.7}, (2.1, 0.0, 1))], [track], asserted) == {0: 0}


def test_without_sightings_or_tracks_there_are_no_pairs(make_sighting, make_track):
    assert found([], [make_track("cup", (2, 0, 1))]) == {}
    assert found([make_sighting({"cup": 0.7}, (2, 0, 1))], []) == {}


@given(boxes, boxes)
def test_the_shared_footprint_is_a_share_and_symmetric(one, other):
    share = shared_footprint(*one, *other)
    assert share >= 0
    assert share == pytest.approx(shared_footprint(*other, *one))


@given(boxes)
def test_a_box_shares_all_of_its_footprint_with_itself(box):
    assert shared_footprint(*box, *box) == pytest.approx(1.0)


def test_what_stands_clear_above_shares_nothing():
    low, high = np.zeros(3), np.array([1.0, 1.0, 0.5])
    above = np.array([0.0, 0.0, 1.0])
    assert shared_footprint(low, high, low + above, high + above) == 0
