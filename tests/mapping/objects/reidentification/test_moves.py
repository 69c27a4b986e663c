"""Moved things: which of the things that appeared are things that left elsewhere."""

from __future__ import annotations

from dataclasses import replace

from mapping.objects.reidentification.moves import (
    Absentee,
    Departures,
    in_one_spot,
    moved_things,
)
from mapping.objects.settings import ObjectSettings

NOW = 1e5
SETTINGS = ObjectSettings()


def track(make_track, category, x, *, first=NOW - 10, last=NOW, **more):
    made = make_track(category, (x, 0, 1), **more)
    made.first_seen, made.last_seen = first, last
    return made


def old(make_track, category, x, **more):
    return track(make_track, category, x, first=0, last=100, **more)


def moves(absent, appeared, count=2):
    return moved_things(absent, appeared, lambda o, age: 0.15, NOW, lambda c: count, SETTINGS)


def test_each_thing_goes_to_one_of_its_category(make_track):
    cup, bottle = old(make_track, "cup", 0), old(make_track, "bottle", 1)
    new = [track(make_track, "bottle", 6), track(make_track, "cup", 5)]
    absent = [Absentee(one, 1.0, looked=True) for one in (cup, bottle)]
    assert {(id(o), id(n)) for o, n in moves(absent, new)} == {
        (id(cup), id(new[1])),
        (id(bottle), id(new[0])),
    }


def test_what_was_not_looked_at_is_not_found_elsewhere(make_track):
    absent = [Absentee(old(make_track, "cup", 0), 0.0, looked=False)]
    assert moves(absent, [track(make_track, "cup", 5)]) == []


def test_what_was_there_before_is_no_thing_that_left(make_track):
    absent = [Absentee(old(make_track, "cup", 0), 1.0, looked=True)]
    assert moves(absent, [track(make_track, "cup", 5, first=50)]) == []


def test_nothing_is_carried_faster_than_it_can_be(make_track):
    absent = [Absentee(old(make_track, "cup", 0), 1.0, looked=True)]
    assert moves(absent, [track(make_track, "cup", 9, first=102)]) == []
    assert len(moves(absent, [track(make_track, "cup", 9, first=110)])) == 1


def test_among_many_of_a_category_a_new_one_is_likely_another(make_track):
    absent = [Absentee(old(make_track, "cup", 0), 1.0, looked=True)]
    assert moves(absent, [track(make_track, "cup", 5)], count=40) == []


def test_one_spot_is_near_and_of_a_common_category(make_track):
    cup = old(make_track, "cup", 0)
    assert in_one_spot(cup, track(make_track, "cup", 0.05), SETTINGS)
    assert not in_one_spot(cup, track(make_track, "cup", 0.5), SETTINGS)
    assert not in_one_spot(cup, track(make_track, "bottle", 0.05), SETTINGS)


def departures(*left, kept=9):
    memory = Departures(replace(SETTINGS, departures=kept))
    memory.remember(left)
    return memory


def named(one, iri):
    one.iri = iri
    return one


def test_a_frame_that_is_not_written_takes_back_its_moves(make_track):
    cup = named(old(make_track, "cup", 0), "cup")
    memory = departures(cup)
    for _ in range(2):  # once more after the first was undone
        new = track(make_track, "cup", 5)
        (move,) = memory.found([], [new], lambda o, age: 0.15, NOW, lambda c: 2)
        assert (move.old, move.track, new.iri, memory.iris) == (cup, new, "cup", frozenset())
        memory.undo()
        assert (memory.tracks, memory.joined) == ([cup], ())
        assert memory.back(track(make_track, "cup", 0)) is None


def test_a_frame_that_is_not_written_forgets_nothing(make_track):
    first, second = (named(old(make_track, "cup", n), f"cup {n}") for n in range(2))
    memory = departures(first, kept=1)
    memory.add([second])
    assert memory.iris == {"cup 1"} and memory.changes(NOW)[1] == {"cup 0"}
    memory.undo()
    assert memory.iris == {"cup 0", "cup 1"} and memory.changes(NOW)[1] == frozenset()


def test_only_the_latest_moves_are_remembered(make_track):
    memory = departures(kept=2)
    for n in range(4):
        memory.remember([named(old(make_track, "cup", 9 * n), f"cup {n}")])
        memory.add([])
        memory.found(
            [], [track(make_track, "cup", 9 * n + 5)], lambda o, age: 0.15, NOW, lambda c: 2
        )
    assert [one.iri for one in memory.tracks] == ["cup 2", "cup 3"]
