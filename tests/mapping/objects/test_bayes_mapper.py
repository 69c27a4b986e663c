"""The Bayes mapper on frames of one room: a real mapper, a real map in memory."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import ConflictError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause, ChangeSet
from kg.serving.opening import create_map, in_memory_map, open_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.existence import MANY, early, logit
from mapping.objects.settings import ObjectSettings
from tests.mapping.objects.room import CUP, MIDDLE, Room, box, detections

FAR_WALL = 5.0  # [m] seen instead of a thing that is gone
CLEAR_VIEWS = 3  # within which a thing that is gone leaves the map


# entering the map


def test_a_thing_is_in_the_map_from_its_first_view_without_certainty(room):
    (record,) = room.see(CUP).objects
    assert record.existence < 0.9
    assert record.p_map == pytest.approx([2, 0, 1], abs=0.05)
    assert room.label(room.one) == "cup"
    assert (record.observations, record.first_seen, record.last_seen) == (1, 1e9, 1e9)
    assert (record.evidence.score, record.evidence.model) == (pytest.approx(0.95), "scripted")
    assert room.see(CUP).objects[0].existence > record.existence


def test_what_was_seen_early_is_less_certain_after_many_views(room, step_back):
    room.see(CUP, times=2)
    before = room.one.existence
    for n in range(MANY):
        frame = step_back(0, id=f"away{n}", stamp=1e9 + 9 + n)
        T = frame.T_map_cam.copy()
        T[1, 3] += 20 + n
        room.mapper.add(replace(frame, T_map_cam=T), detections())
    assert room.one.existence == before, "it was not judged since"
    room.mapper.flush()
    assert logit(before) - logit(room.one.existence) == pytest.approx(early(2), abs=0.1)


def test_a_camera_that_stands_still_maps_what_it_sees_again_and_again(room, step_back):
    small = ("cup", 0.9, (30, 22, 33, 25))
    for n in range(40):
        room.mapper.add(step_back(0, id=f"f{n}", stamp=1e9 + n), detections(small))
    assert room.one.existence > 0.8
    assert room.one.observations == 40


# one thing or several


def test_two_cups_side_by_side_are_two(room):
    for n in range(4):
        scale = 2 / (2 + 0.3 * n)  # 0.3 m are fewer pixels from farther off
        halves = [("cup", 0.8, box(32 + side * 3.75 * scale, half=2)) for side in (-1, 1)]
        room.see(*halves)
    one, other = room.map.objects()
    assert abs(one.p_map[1] - other.p_map[1]) == pytest.approx(0.3, abs=0.05)
    assert {one.observations, other.observations} == {4}


def test_a_thing_called_otherwise_by_each_view_is_one_by_its_best(room):
    screen = (22, 16, 42, 32)
    for name, score in (("tv", 0.8), ("laptop", 0.4), ("tv", 0.8), ("suitcase", 0.4), ("tv", 0.8)):
        room.see((name, score, screen))
    assert room.label(room.one) == "tv"
    assert room.one.observations == 5


def test_what_two_detectors_see_is_one_thing_by_the_better_score(room, step_back):
    names = ("ssdlite_mobilenet_v2_coco_300", "nanodet_g_416")
    alone, agreed = ("cup", 0.55, box(10)), [("cup", 0.55, box(54)), ("cup", 0.7, box(54))]
    seen = detections(alone, *agreed, source=(names[0], *names), detectors=names)
    for n in range(3):
        room.mapper.add(step_back(n), seen)
    left, right = sorted(room.map.objects(), key=lambda o: -o.p_map[1])
    assert left.existence < right.existence
    assert {left.evidence.model, right.evidence.model} <= set(names)


def test_a_look_by_one_network_of_a_pair_counts_less_against_what_both_may_see(step_back):
    """Frames between the views of the second network show little that only this one names."""

    def existence(*later: str) -> float:
        with in_memory_map(base="https://example.org/pair/") as semantic_map:
            mapper = Mapper(semantic_map, detector="scripted")
            for view in range(8):
                looking = ("quick", "careful") if view % 4 == 0 else later
                found = [] if view % 4 else [("cup", 0.7, MIDDLE)]
                mapper.add(step_back(view), detections(*found, detectors=looking))
            (cup,) = mapper.objects()
            return cup.existence

    assert existence("quick") > 1.2 * existence("quick", "careful")


@pytest.mark.parametrize(("right", "objects"), [(65, 1), (60, 2)], ids=["cut", "whole"])
def test_a_box_cut_by_the_border_beside_a_thing_of_its_name_is_no_second_one(
    semantic_map, step_back, right, objects
):
    mapper = Mapper(semantic_map)
    chair, beside = ("chair", 0.8, (35, 16, 49, 36)), ("chair", 0.8, (53, 16, right, 36))
    for n, seen in enumerate([[chair]] * 3 + [[chair, beside]] * 2):
        frame = step_back(0, depth=1.0, id=f"f{n}", stamp=1e9 + n)
        mapper.add(frame, detections(*seen))
    assert len(semantic_map.objects()) == objects


# leaving the map


def test_a_thing_that_is_gone_leaves_within_three_clear_views(room):
    room.see(CUP, times=6)
    iri = room.one.iri
    removed = [room.look(FAR_WALL).removed for _ in range(CLEAR_VIEWS)]
    assert [iri] in [list(gone) for gone in removed]
    assert room.map.objects() == ()


def test_a_thing_that_is_there_but_missed_once_stays(room):
    room.see(CUP, times=6)
    room.look(2.0 + 0.3 * 6)
    assert room.one.existence > 0.5


@pytest.mark.parametrize("depth", [1.0, np.nan], ids=["hidden", "without depth"])
def test_what_cannot_be_seen_is_not_missed(room, depth):
    room.see(CUP, times=3)
    before = room.one
    for _ in range(10):
        assert room.look(depth).objects == ()
    assert room.one.existence == before.existence


# moving


def elsewhere(view: int, label: str = "cup") -> tuple[str, float, tuple[float, ...]]:
    """A detection 0.8 m beside the middle, from that view."""
    scale = 2 / (2 + 0.3 * view)
    return label, 0.8, box(32 + 20 * scale, half=3 * scale)


def appears(room, *others, label="cup"):
    for _ in range(3):
        room.see(*others, elsewhere(room.views % 8, label))


def leaves(room):
    for _ in range(CLEAR_VIEWS):
        room.look(FAR_WALL)


def test_a_thing_that_came_back_is_the_same_one(room):
    room.see(CUP, times=4)
    first = room.one
    leaves(room)
    assert room.map.objects() == ()
    room.see(CUP, times=3)
    assert (room.one.iri, room.one.first_seen) == (first.iri, first.first_seen)
    assert room.one.observations == first.observations + 3


def test_a_thing_that_appeared_before_its_old_spot_was_looked_at_is_the_same_one(room, step_back):
    room.see(CUP, times=4)
    first = room.one
    room.map.assertions.add(first.iri, "label", "Ann's cup", by="ann")
    later = first.last_seen + 86400
    for n in range(3):  # the old spot has no depth
        frame = step_back(n)
        frame.depth[:, :42] = np.nan
        room.mapper.add(replace(frame, stamp=later + n), detections(elsewhere(n)))
    old, new = room.map.objects()
    assert old.iri == first.iri != new.iri
    removed = []
    for n in range(CLEAR_VIEWS):
        frame = step_back(n)
        frame.depth[:, :42] = FAR_WALL
        update = room.mapper.add(replace(frame, stamp=later + 10 + n), detections(elsewhere(n)))
        removed += update.removed
    assert removed == [new.iri]
    assert room.one.iri == first.iri
    assert np.linalg.norm(room.one.p_map - new.p_map) < 0.3
    assert [a.value for a in room.map.assertions.all(first.iri)] == ["Ann's cup"]


def test_what_people_say_is_there_is_not_found_elsewhere(room):
    room.see(CUP, times=4)
    first = room.one.iri
    room.map.assertions.add(first, "existence", "present", by="ann")
    leaves(room)
    appears(room)
    assert {o.iri for o in room.map.objects()} > {first}


def test_a_move_is_undone_where_the_thing_stands_in_its_old_spot_after_all(room):
    room.see(CUP, times=4)
    first, where = room.one.iri, room.one.p_map
    leaves(room)
    appears(room)
    assert room.one.iri == first
    appears(room, CUP)
    by_iri = {o.iri: o.p_map for o in room.map.objects()}
    assert len(by_iri) == 2
    assert np.linalg.norm(by_iri[first] - where) < 0.2


# what people say


def test_an_asserted_category_sticks_and_both_names_are_its_own(room):
    room.see(CUP, times=2)
    room.map.assertions.add(room.one.iri, "category", "bowl", by="ann")
    room.see(("bowl", 0.6, MIDDLE), times=2)
    room.see(CUP, times=2)
    assert room.label(room.one) == "bowl"
    assert room.one.observations == 6
    room.map.assertions.retract(room.one.iri, "category", by="ann")
    assert room.label(room.one) == "cup"


def test_what_is_put_elsewhere_is_not_missed_where_it_was(room):
    room.see(CUP, times=3)
    room.map.assertions.add(room.one.iri, "position", (4, 9, 1), by="ann")
    for _ in range(6):
        room.look(FAR_WALL)
    assert room.one.p_map == pytest.approx([4, 9, 1])


def test_asserted_present_it_stays_though_missed(room):
    room.see(CUP, times=2)
    room.map.assertions.add(room.one.iri, "existence", "present", by="ann")
    for _ in range(6):
        room.look(FAR_WALL)
    assert room.one.existence > 0
    room.map.assertions.retract(room.one.iri, "existence", by="ann")
    room.look(FAR_WALL)
    assert room.map.objects() == ()


def test_deleted_and_seen_again_it_is_new(room):
    room.see(CUP, times=3)
    first = room.one.iri
    room.map.update(f"DELETE WHERE {{ <{first}> ?p ?o }}", by="ann")
    assert room.map.objects() == ()
    room.see(CUP, times=2)
    assert room.one.iri != first and room.one.observations == 2


def test_moved_by_an_update_it_goes_on_from_there(room):
    room.see(CUP, times=2)
    iri = room.one.iri
    room.map.update(
        f"DELETE {{ <{iri}> here:y ?y }} INSERT {{ <{iri}> here:y -0.2 }} "
        f"WHERE {{ <{iri}> here:y ?y }}",
        by="ann",
    )
    room.see(CUP)
    assert room.one.iri == iri
    assert -0.2 < room.one.p_map[1] < 0


# other writers and other runs


def test_what_another_writes_between_frames_is_respected(room):
    room.see(CUP, ("bottle", 0.8, box(55)), times=3)
    cup, bottle = sorted(room.map.objects(), key=lambda o: abs(o.p_map[1]))
    moved = replace(cup, p_map=np.array([2.0, 0.1, 1.0]), observations=9)
    cause = Cause("import", "somebody")
    room.map.apply(MapUpdate(objects=(moved,), removed=(bottle.iri,)), cause)
    room.see(CUP)
    assert room.one.iri == cup.iri
    assert room.one.observations == 10
    assert 0 < room.one.p_map[1] <= 0.1


@pytest.mark.parametrize("views", [0, 1, 2], ids=["a new thing", "a new object", "an object"])
def test_a_frame_that_conflicts_counts_once(room, step_back, views, monkeypatch):
    for _ in range(views):
        room.see(CUP)
    apply, refused = room.map.apply, 2

    def contested(update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        nonlocal refused
        if refused:
            refused -= 1
            raise ConflictError("others were faster")
        return apply(update, cause)

    monkeypatch.setattr(room.map, "apply", contested)
    room.see(CUP)
    monkeypatch.undo()
    assert room.one.observations == views + 1
    alone = Room(in_memory_map(), step_back)
    alone.see(CUP, times=views + 1)
    assert room.one.existence == pytest.approx(alone.one.existence, abs=0.05)


def test_a_map_opened_again_goes_on_with_its_objects(tmp_path, step_back):
    with create_map(tmp_path / "a.map") as semantic_map:
        first = Room(semantic_map, step_back)
        first.see(CUP, ("chair", 0.8, (8, 18, 24, 34)), times=4)
        before = {o.iri: o for o in semantic_map.objects()}
        assert len(before) == 2
    with open_map(tmp_path / "a.map") as semantic_map:
        second = Room(semantic_map, step_back)
        second.see(CUP, ("chair", 0.8, (8, 18, 24, 34)), times=3)
        after = {o.iri: o for o in semantic_map.objects()}
        assert after.keys() == before.keys()
        for iri, record in after.items():
            assert record.observations == 7
            assert record.existence >= before[iri].existence - 0.02
            assert record.extent == pytest.approx(before[iri].extent, abs=0.15)
        for _ in range(CLEAR_VIEWS):
            second.look(FAR_WALL + 1)
        assert semantic_map.objects() == ()


# evidence and merging


def test_looks_in_vain_count_against_an_object(semantic_map, step_back):
    room = Room(semantic_map, step_back)
    room.see(CUP, times=3)
    mapper = BayesObjectMapper(semantic_map)
    unsure = mapper.decay(room.one.iri, recall=0.5)
    once = mapper.decay(room.one.iri)
    assert once.updated[0].existence < unsure.updated[0].existence < room.one.existence
    gone = mapper.decay(room.one.iri, 500)
    assert gone.removed == (room.one.iri,)
    assert mapper.decay("https://example.org/map/object/99").updated == ()


@pytest.mark.parametrize("asserted", [False, True])
def test_an_object_with_assertions_is_merged_into_no_other(room, asserted):
    room.see(("cup", 0.9, box(16)), ("cup", 0.8, box(48)), times=2)
    _, other = sorted(room.map.objects(), key=lambda record: -record.existence)
    if asserted:
        room.map.assertions.add(other.iri, "existence", "present", by="ann")
    room.mapper = Mapper(room.map, MappingOptions(objects=ObjectSettings(separation=100.0)))
    room.see(("cup", 0.9, box(16)))
    assert (other.iri in {record.iri for record in room.map.objects()}) == asserted


@pytest.mark.parametrize(("later", "things"), [(3000.0, 1), (3700.0, 2)])
def test_a_cup_beside_the_spot_of_one_last_seen_long_ago_is_another(room, step_back, later, things):
    room.see(("cup", 0.95, box(32, half=1.5)), times=3)
    aside = ("cup", 0.95, box(36, half=1.5))
    room.mapper.add(step_back(3, stamp=1e9 + later), detections(aside))
    assert len(room.map.objects()) == things
