"""Tracks: evidence of one thing adds up, and is read again from what was written of it."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.areas import OrientedBox
from kg.model.usual_sizes import UsualSize
from mapping.objects.existence import CategoryEvidence, logit
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import (
    SEEN_TOGETHER,
    Track,
    count_together,
    same_facts,
    track_of,
    track_of_departed,
    viewpoint,
)

SETTINGS = ObjectSettings()


@pytest.fixture
def cup(make_track):
    """A cup of 0.2 m at (2, 0, 1), written as object 1."""
    track = make_track("cup", (2, 0, 1), size=0.2)
    track.iri, track.observations = "object/1", 3
    track.first_seen, track.last_seen = 10.0, 20.0
    return track


def camera(x: float = 0.1, turn: float = 0.1, tilt: float = 0.1) -> np.ndarray:
    T = np.eye(4)
    flat = np.cos(tilt)
    T[:3, 2] = flat * np.cos(turn), flat * np.sin(turn), np.sin(tilt)
    T[:3, 3] = x, 0.1, 1.3
    return T


def test_a_viewpoint_is_a_cell_of_position_and_of_direction():
    same = [camera(), camera(x=0.29), camera(turn=0.25), camera(tilt=0.25)]
    other = [camera(x=0.31), camera(x=-0.1), camera(turn=0.27), camera(turn=-0.1), camera(tilt=0.3)]
    assert {viewpoint(T) for T in same} == {viewpoint(camera())}
    assert len({viewpoint(T) for T in [camera(), *other]}) == 6


def test_the_nth_look_from_a_viewpoint_counts_one_nth(cup):
    assert [cup.look((7,)) for _ in range(3)] == pytest.approx([1, 1 / 2, 1 / 3])
    assert cup.look((8,)) == 1
    for n in range(100, 199):
        cup.look((n,))
    assert cup.look((8,)) == 1 / 2
    assert cup.look((7,)) == 1  # only the latest 100 are remembered


def test_a_position_is_a_mean_in_which_near_and_whole_sightings_weigh_more(
    make_track, make_sighting
):
    def shift(**fields):
        track = make_track("cup", (2, 0, 1))
        track.observations = 3
        track.locate(replace(make_sighting({"cup": 0.8}, (2, 0.08, 1)), **fields), 1.0)
        return track.p_map[1]

    assert shift() == pytest.approx(0.08 / 4)  # after three
    assert shift(depth=1.0) == pytest.approx(0.08 * 2 / 5)
    assert shift(cut=True) == pytest.approx(0.08 * 0.3 / 3.3)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_sighting_beyond_every_gate_starts_position_and_extent_anew(cup, make_sighting, side):
    reach = SETTINGS.gate + 2 * SETTINGS.gate_size * 0.2 + 0.5
    near = make_sighting({"cup": 0.8}, (2, side * (reach - 0.01), 1), size=0.2)
    cup.locate(near, 1.0)
    assert 0.0 < side * cup.p_map[1] < reach / 2
    far = make_sighting({"cup": 0.8}, (2, cup.p_map[1] + side * (reach + 0.01), 1), size=0.2)
    cup.locate(far, 1.0)
    assert cup.p_map == pytest.approx(far.p_map)
    assert (cup.low, cup.high) == (pytest.approx(far.low), pytest.approx(far.high))


def test_a_few_boxes_that_are_too_large_do_not_widen_an_extent(make_track):
    track = make_track("cup", (2, 0, 1), views=20, size=0.2)
    track.add_box(np.array([0.0, -2.0, 0.0]), np.array([4.0, 2.0, 2.0]))
    assert track.high - track.low == pytest.approx([0.2] * 3)
    assert len(track.lows) == 21
    for _ in range(10):
        track.add_box(track.low, track.high)
    assert len(track.lows) == len(track.highs) == SETTINGS.voices


def test_the_size_is_the_median_of_whole_boxes(make_track, make_sighting):
    track = make_track("cup", (2, 0, 1), size=0.2)
    for size in (0.3, 0.3, 0.3, 0.3):
        track.locate(make_sighting({"cup": 0.8}, (2, 0, 1), size=size), 1.0)
    track.locate(make_sighting({"cup": 0.8}, (2, 0, 1), size=2.0, cut=True), 1.0)
    assert track.size == pytest.approx(0.3)


@pytest.mark.parametrize(("size", "metres"), [(0.2, 0.09), (2.5, 0.55), (9.0, 0.65)])
def test_a_position_is_less_certain_of_a_larger_thing(make_track, size, metres):
    assert make_track("cup", (2, 0, 1), size=size).deviation == pytest.approx(metres)


def test_a_long_thing_stands_at_the_centre_of_its_extent(make_track):
    for size, expected in ((0.29, 2.0), (0.31, 2.5)):
        track = make_track("cup", (2, 0, 1), size=size)
        track.low, track.high = track.low + 0.5, track.high + 0.5
        assert track.outline.centre[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("seen", "ends"),
    [
        ((0.72, 0.84), (0.4, 0.84)),  # its back, behind a table
        ((0.0, 0.3), (0.0, 0.72)),  # its seat, below the camera
        ((0.01, 0.82), (0.01, 0.82)),  # the whole
        ((3.2, 3.4), (3.2, 3.4)),  # on another storey, whose floor is not known here
        ((-2.6, -2.2), (-2.6, -2.2)),
    ],
)
@pytest.mark.parametrize("grown", [True, False])
def test_what_stands_on_the_floor_has_its_hidden_parts(make_track, seen, ends, grown):
    """The place of a chair is that of the whole, however much of it was seen."""
    bottom, top = seen
    seat = UsualSize(0.8, 0.45, (1.2, 0.8, 0.8), stands=0.8)
    track = make_track("seat", (2, 0, (bottom + top) / 2), size=0.5)
    track.low[2], track.high[2] = bottom, top
    if grown:
        track.box = OrientedBox(
            np.array([2, 0, (bottom + top) / 2]), np.array([0.5, 0.4, top - bottom]), 0.3
        )
    for usual, expected in ((seat, ends), (UsualSize(0.8, 0.45), seen)):
        track.assess({"seat": usual}.get)
        assert track.record().p_map[2] == pytest.approx((bottom + top) / 2), "others measured it"
        track.views[7,] = np.zeros(23, np.float32)
        z, height = track.record().p_map[2], track.record().extent[2]
        assert (z - height / 2, z + height / 2) == pytest.approx(expected, abs=0.03)
        track.views.clear()


def test_an_alternative_is_written_again_only_where_it_changed(cup):
    cup.evidence["bottle"] = CategoryEvidence(strength=30.0, looks=cup.looks)
    cup.assess({}.get)
    (p,) = cup.alternatives.values()
    for before, expected in ((p - 0.03, p - 0.03), (p + 0.03, p + 0.03), (p - 0.05, p)):
        cup.labels = {"bottle": before}
        assert cup.alternatives == {"bottle": pytest.approx(expected)}


def test_a_name_that_its_box_contradicts_gives_way_to_one_that_fits(make_track):
    """A detector says "cup" of a bottle of 0.3 m, and sometimes "bottle"."""
    usual = {"cup": UsualSize(0.1, 0.08, (0.18, 0.14, 0.13)), "bottle": UsualSize(0.25, 0.08)}
    track = make_track("cup", (2, 0, 1), size=0.12)
    track.evidence["bottle"] = CategoryEvidence(strength=20.0)
    track.assess(usual.get)
    assert (track.name, set(track.alternatives)) == ("cup", {"bottle"})
    track.box = OrientedBox(np.array([2.0, 0, 1]), np.array([0.1, 0.1, 0.32]), 0.3)
    track.assess(usual.get)
    assert (track.name, set(track.alternatives)) == ("bottle", {"cup"})
    assert (track.record().category, track.category) == ("bottle", "cup"), "it is followed as one"
    again = track_of(track.record(), SETTINGS, usual.get)
    assert (again.name, again.certainty) == ("bottle", pytest.approx(track.certainty, abs=0.01))


def test_looks_that_show_it_under_another_name_are_no_misses(cup):
    before = cup.judged["cup"]
    cup.evidence["bottle"] = CategoryEvidence(strength=3.0, looks=50.0)
    cup.looks = 50.0
    cup.assess({}.get)
    assert cup.judged["cup"] == pytest.approx(before)
    cup.looks = 60.0
    cup.assess({}.get)
    assert cup.judged["cup"] < before


def test_a_thing_that_may_have_left_is_there_with_less_probability(cup):
    cup.absence.empty(1.0, 1.0)
    before = cup.existence
    cup.assess({}.get, 0.0)
    assert cup.existence == pytest.approx(before)
    cup.assess({}.get, 0.5)
    assert cup.absent == pytest.approx(1 / (1 + np.exp(-1)))
    assert cup.existence == pytest.approx(before * (1 - cup.absent))
    assert (cup.peak, cup.presence) == (pytest.approx(before), pytest.approx(before))


def test_merged_tracks_have_the_evidence_of_both(cup, make_track):
    other = make_track("cup", (2.3, 0, 1), size=0.2, views=6)
    other.observations, other.first_seen, other.last_seen, other.last_frame = 6, 5.0, 15.0, 9
    looks, strength = cup.looks + other.looks, other.evidence["cup"].strength
    strength += cup.evidence["cup"].strength
    share = cup.weight / (cup.weight + other.weight)
    other.viewpoints[0,] = 7
    cup.viewpoints[1,] = 8
    cup.merge(other)
    assert cup.looks == pytest.approx(looks)
    assert cup.evidence["cup"].strength == pytest.approx(strength)
    assert cup.p_map[0] == pytest.approx(2 * share + 2.3 * (1 - share))
    assert (cup.observations, cup.first_seen, cup.last_seen, cup.last_frame) == (9, 5.0, 20.0, 9)
    assert (cup.viewpoints[0,], cup.viewpoints[1,]) == (7, 8)
    assert len(cup.lows) == len(cup.sizes) == 9
    assert cup.high[0] == pytest.approx(2.4)


def test_a_thing_that_moved_keeps_its_past(cup, make_track):
    here = make_track("cup", (7, 0, 1))
    here.observations, here.first_seen, here.last_seen = 1, 90.0, 90.0
    here.becomes(cup)
    assert (here.iri, here.observations, here.first_seen) == ("object/1", 4, 10.0)
    assert (here.last_seen, here.p_map[0]) == (90.0, 7.0)


def test_what_is_written_is_read_again(cup, usual_size):
    cup.evidence["bottle"] = CategoryEvidence(strength=30.0, looks=cup.looks)
    cup.assess({}.get)
    record = cup.record()
    assert record.confidence == pytest.approx(3 * cup.existence)
    again = track_of(record, SETTINGS, usual_size)
    assert (again.category, set(record.labels)) == ("cup", {"bottle"})
    assert again.existence == pytest.approx(cup.existence, abs=0.01)
    assert again.alternatives == pytest.approx(cup.alternatives, abs=0.01)
    assert again.outline.centre == pytest.approx(cup.outline.centre)
    assert again.size == pytest.approx(0.2)
    assert (again.low, again.high) == (pytest.approx(cup.low), pytest.approx(cup.high))
    assert (again.observations, again.first_seen, again.last_seen) == (3, 10.0, 20.0)
    assert same_facts(again.record(), record)
    bare = track_of(replace(record, extent=None), SETTINGS, usual_size)
    assert bare.size == pytest.approx(0.1)  # the usual size of cups


def test_a_thing_that_left_is_remembered_as_it_was(cup, usual_size):
    cup.peak = 0.8
    left = cup.departed_record(15.0)
    assert (left.found_gone, cup.departed_record(25.0).found_gone) == (20.0, 25.0)
    again = track_of_departed(left, SETTINGS, usual_size)
    assert again.existence == pytest.approx(0.8, abs=0.01)
    assert again.log_odds["cup"] == pytest.approx(logit(0.8), abs=0.01)
    assert again.outline.centre == pytest.approx(cup.outline.centre)


@pytest.mark.parametrize(
    ("fields", "same"),
    [
        ({}, True),
        ({"existence": 0.510}, True),
        ({"existence": 0.515}, False),
        ({"p_map": np.array([2.01, 0.0, 1.0])}, True),
        ({"p_map": np.array([2.0, 0.015, 1.0])}, False),
        ({"category": "bowl"}, False),
        ({"observations": 4}, False),
    ],
)
def test_records_are_the_same_up_to_rounding(cup, fields, same):
    record = replace(cup.record(), existence=0.5, p_map=np.array([2.0, 0.0, 1.0]))
    assert same_facts(record, replace(record, **fields)) is same
    assert same_facts(replace(record, **fields), record) is same


def test_things_in_one_frame_are_counted_as_different(make_track):
    tracks: list[Track] = [make_track("cup", (x, 0, 1)) for x in (1, 2, 3)]
    count_together(tracks[:2])
    count_together(tracks)
    a, b, c = (track.number for track in tracks)
    assert tracks[0].together == {b: 2, c: 1}
    for _ in range(9):
        count_together(tracks)
    assert tracks[2].together == {a: SEEN_TOGETHER, b: SEEN_TOGETHER}


def test_what_was_seen_very_often_still_follows_what_is_seen(make_track, make_sighting):
    track, moved = (
        make_track("cup", (0, 0, 1), views=300),
        make_sighting({"cup": 0.8}, (0.05, 0, 1)),
    )
    for _ in range(30):
        track.locate(moved, 1.0)
    assert 0.025 < track.p_map[0] < 0.05
