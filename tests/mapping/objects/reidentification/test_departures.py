"""Departures, moves and merges of objects."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.records import DepartedRecord, MapUpdate
from kg.model.transactions import Cause
from kg.serving.opening import create_map, open_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.reidentification.identity import duplicates, same_thing
from mapping.objects.reidentification.moves import Absentee, Departures, in_one_spot, moved_things
from mapping.objects.settings import ObjectSettings
from perception.frames import Detections, Frame

View = Callable[..., Frame]
FAR_WALL = 5.0  # [m] seen instead of a thing that is gone


LATER = 3600.0  # [s] after the first views


def see(mapper: Mapper, view: View, *boxes: tuple[str, float, float], after: float = 0.0) -> None:
    """Three views of things (label, metres beside the middle, score), `after` [s] later."""
    for n in range(3):
        scale = 2 / (2 + 0.3 * n)
        corners = [
            (32 + (25 * x - 3) * scale, 24 - 3 * scale, 32 + (25 * x + 3) * scale, 24 + 3 * scale)
            for _, x, _ in boxes
        ]
        scores = np.array([score for *_, score in boxes], dtype=np.float32)
        found = Detections(
            np.array(corners, np.float32).reshape(-1, 4), scores, tuple(b[0] for b in boxes)
        )
        frame = view(n)
        mapper.add(replace(frame, stamp=frame.stamp + after), found)


def leave(mapper: Mapper, view: View) -> list[MapUpdate]:
    """Three views in which nothing is there."""
    nothing = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
    frames = [view(n) for n in range(3)]
    return [
        mapper.add(replace(frame, depth=np.full_like(frame.depth, FAR_WALL)), nothing)
        for frame in frames
    ]


CUP, ELSEWHERE = ("cup", 0.0, 0.8), ("cup", 0.8, 0.8)


def mapped_and_left(semantic_map: SemanticMap, view: View) -> str:
    mapper = Mapper(semantic_map)
    see(mapper, view, CUP)
    (cup,) = semantic_map.objects()
    leave(mapper, view)
    (departed,) = semantic_map.departed()
    assert (semantic_map.objects(), departed.iri) == ((), cup.iri)
    assert departed.observations == cup.observations
    return cup.iri


def test_after_a_restart_what_left_is_found_elsewhere(tmp_path: Path, step_back: View) -> None:
    with create_map(tmp_path / "a.map") as semantic_map:
        iri = mapped_and_left(semantic_map, step_back)
    with open_map(tmp_path / "a.map") as semantic_map:
        see(Mapper(semantic_map), step_back, ELSEWHERE, after=LATER)
        (cup,) = semantic_map.objects()
        assert (cup.iri, cup.observations, semantic_map.departed()) == (iri, 6, ())
        assert cup.p_map[1] < -0.5 or cup.p_map[1] > 0.5
        assert check_map(semantic_map.engine) == []


def test_what_another_mapper_found_gone_is_found_elsewhere(semantic_map, step_back):
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    seen = cup.first_seen, cup.last_seen, cup.last_seen + 1
    departed = DepartedRecord(cup.iri, cup.category, cup.p_map, 0.9, 3, *seen, cup.extent)
    update = MapUpdate(removed=(cup.iri,), departed=(departed,))
    semantic_map.apply(update, Cause("frame", "another"))
    see(mapper, step_back, ELSEWHERE, after=LATER)
    assert [found.iri for found in semantic_map.objects()] == [cup.iri]


def test_what_people_delete_is_not_found_again(semantic_map: SemanticMap, step_back: View) -> None:
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    leave(mapper, step_back)
    semantic_map.update(f"DELETE WHERE {{ <{cup.iri}> ?p ?o }}")
    see(mapper, step_back, ELSEWHERE, after=LATER)
    (new,) = semantic_map.objects()
    assert new.iri != cup.iri


def test_what_people_say_is_not_there_is_not_remembered(semantic_map, step_back):
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    semantic_map.assertions.add(cup.iri, "existence", "absent", by="ann")
    leave(mapper, step_back)
    assert semantic_map.departed() == ()


@pytest.mark.parametrize("again", [False, True])
def test_only_the_latest_are_kept(semantic_map: SemanticMap, step_back: View, again: bool) -> None:
    mapper = Mapper(semantic_map, MappingOptions(objects=ObjectSettings(departures=1)))
    for label in ("cup", "bottle"):
        see(mapper, step_back, (label, 0.0, 0.8))
        leave(mapper, step_back)
        if again:  # a restart between them
            mapper = Mapper(semantic_map, MappingOptions(objects=ObjectSettings(departures=1)))
    (departed,) = semantic_map.departed()
    assert semantic_map.catalogue.label(departed.category) == "bottle"
    assert check_map(semantic_map.engine) == []


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
    for x, first in ((5, 50), (0.3, 100)):
        assert moves(absent, [track(make_track, "cup", x, first=first)]) == []
    assert len(moves(absent, [track(make_track, "cup", 0.3, first=101)])) == 1


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


@pytest.mark.parametrize("seed", range(12))
def test_no_iri_is_given_and_given_up_in_one_frame(make_track, seed):
    """Things that left their spot may have appeared somewhere else before."""
    rng = np.random.default_rng(seed)
    tracks = []
    for number, x in enumerate(rng.uniform(0, 4, 6)):
        first = NOW - rng.choice([3000, 2000, 1000])
        one = track(make_track, "cup", x, first=first, last=first + rng.choice([10, 900]))
        tracks.append(named(one, f"object/{number}"))
    absent = [Absentee(one, 1.0, looked=bool(rng.random() < 0.7)) for one in tracks]
    found = departures().found(absent, tracks, lambda o, age: 0.15, NOW, lambda c: 1)
    given = [move.track.iri for move in found]
    assert len(given) == len({*given})
    assert {move.former_iri for move in found}.isdisjoint(given)
    assert {id(move.old) for move in found}.isdisjoint(id(move.track) for move in found)


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


def test_what_had_not_left_is_not_remembered_by_a_frame_that_is_not_written(make_track):
    cup, new = named(old(make_track, "cup", 0), "cup"), track(make_track, "cup", 5)
    memory = departures()
    absent = [Absentee(cup, 1.0, looked=True)]
    assert memory.found(absent, [new], lambda o, age: 0.15, NOW, lambda c: 2)
    memory.undo()
    assert memory.tracks == []


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
