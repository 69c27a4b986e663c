"""Merging: which tracks turn out to be one thing."""

from __future__ import annotations

import pytest

from mapping.objects.reidentification.identity import duplicates, same_thing
from mapping.objects.settings import ObjectSettings

SETTINGS = ObjectSettings()


def together(a, b, times):
    """Frames that show both, as different detections."""
    a.together[b.number] = b.together[a.number] = times


@pytest.fixture
def same(usual_size):
    def check(a, b):
        assert same_thing(a, b, usual_size, SETTINGS) == same_thing(b, a, usual_size, SETTINGS)
        return same_thing(a, b, usual_size, SETTINGS)

    return check


@pytest.mark.parametrize("seen_together", [0, 5])
def test_two_cups_side_by_side_stay_two(make_track, same, seen_together):
    cups = [make_track("cup", (2, y, 1)) for y in (0.0, 0.3)]
    together(*cups, seen_together)
    assert not same(*cups)


def test_two_of_a_kind_in_one_spot_are_one(make_track, same):
    cups = [make_track("cup", (2, y, 1)) for y in (0.0, 0.02)]
    together(*cups, 5)  # two boxes of one cup in the same images
    assert same(*cups)


def test_two_cups_seen_beside_each_other_are_two_even_if_near(make_track, same):
    cups = [make_track("cup", (2, y, 1)) for y in (0.0, 0.09)]
    assert same(*cups)
    together(*cups, 2)
    assert not same(*cups)


def test_two_parts_of_one_table_are_one(make_track, same):
    parts = [
        make_track("dining table", (x, 0, 0.7), size=1.4, sides=(1.4, 0.8, 0.1)) for x in (2, 2.25)
    ]
    together(*parts, 1)
    assert same(*parts)
    other = make_track("dining table", (2, 2.0, 0.7), size=1.4, sides=(1.4, 0.8, 0.1))
    assert not same(parts[0], other)


def test_the_ends_of_one_table_are_one_and_those_of_two_are_not(make_track, same):
    """Ends that do not touch: no longer together than a table usually is, or longer."""
    ends = [make_track("dining table", (x, 0, 0.7), size=0.3) for x in (2.0, 3.2, 5.0)]
    assert same(ends[0], ends[1])
    assert not same(ends[1], ends[2])
    together(ends[0], ends[1], 2)
    assert not same(ends[0], ends[1])
    cups = [make_track("cup", (x, 0, 0.7)) for x in (2.0, 2.4)]
    assert not same(*cups), "small things are not seen in parts"


def test_two_names_of_one_spot_are_one_unless_seen_together(make_track, same):
    tv, laptop = make_track("tv", (2, 0, 1), size=0.5), make_track("laptop", (2, 0.1, 1), size=0.4)
    assert same(tv, laptop)
    together(tv, laptop, 2)
    assert not same(tv, laptop)
    assert not same(tv, make_track("laptop", (2, 0.4, 1), size=0.4))


def test_a_cup_on_a_table_is_another_thing(make_track, same):
    table = make_track("dining table", (2, 0, 0.7), size=1.4, sides=(1.4, 0.8, 0.1))
    assert not same(table, make_track("cup", (2, 0, 0.8)))


def test_objects_of_the_map_absorb_candidates_and_likely_ones_others(make_track, usual_size):
    def pair(a, b):
        ((kept, absorbed),) = duplicates([a], [a, b], usual_size, SETTINGS)
        return kept, absorbed

    one, other = make_track("cup", (2, 0, 1)), make_track("cup", (2, 0.01, 1))
    one.peak, other.peak, other.first_seen = 0.4, 0.6, one.first_seen + 1
    assert pair(one, other) == pair(other, one) == (other, one)
    one.peak = 0.6
    assert pair(one, other) == pair(other, one) == (one, other)
    other.iri = "object/1"
    assert pair(one, other) == pair(other, one) == (other, one)


def test_each_track_is_absorbed_once_and_absorbs_nothing_then(make_track, usual_size):
    tracks = [make_track("cup", (2, 0.01 * n, 1)) for n in range(4)]
    for n, track in enumerate(reversed(tracks)):
        track.first_seen = float(n)
    found = duplicates(tracks, tracks, usual_size, SETTINGS)
    absorbed = [id(gone) for _, gone in found]
    assert len(set(absorbed)) == len(absorbed) == 3
    (left,) = [track for track in tracks if id(track) not in absorbed]
    assert left is tracks[-1]


def test_a_merged_track_knows_what_both_knew(make_track):
    one = make_track("tv", (2, 0, 1), views=2, size=0.5)
    other = make_track("laptop", (2, 0.2, 1), views=1, size=0.4)
    one.observations, other.observations = 2, 1
    one.merge(other)
    one.assess({})
    assert (one.observations, len(one.viewpoints), one.category) == (3, 2, "tv")
    assert set(one.evidence) == {"tv", "laptop"}
    assert 0 < one.p_map[1] < 0.1


def test_untouched_tracks_are_not_looked_at(make_track, usual_size):
    tracks = [make_track("cup", (2, 0.01 * n, 1)) for n in range(2)]
    assert duplicates([], tracks, usual_size, SETTINGS) == []
