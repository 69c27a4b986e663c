"""Sightings, and their association with objects."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kg.model.usual_sizes import usual_sizes
from mapping.frames.sighting import Sighting
from mapping.labels.label_resolver import LabelResolver
from mapping.objects.association import assign, associate, shared_footprint
from mapping.objects.settings import ObjectSettings
from mapping.objects.sightings import SightingExtractor, intersection_over_union
from perception.frames import Detections

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
    for shift, pairs in ((0.2, {0: 0}), (0.21, {})):  # 0.1 + 0.12 (0.1 + 0.1) + 0.02 x 2^2 m
        cup = make_sighting({"cup": 0.7}, (2, shift, 1))
        assert found([cup], [make_track("cup", (2, 0, 1))]) == pairs
    table = make_sighting({"dining table": 0.7}, (2, 0.45, 1), size=1.2)
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


Costs = NDArray[np.float64]


@st.composite
def costs(draw: st.DrawFn) -> Costs:
    """Small cost matrices in which some pairs are impossible."""
    shape = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    cell = st.one_of(st.just(np.inf), st.integers(0, 50).map(lambda n: n / 10))
    values = draw(st.lists(cell, min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
    return np.array(values, dtype=np.float64).reshape(shape)


def best(cost: Costs) -> tuple[int, float]:
    """Most pairs that can be made, and the least total cost of that many."""
    rows, columns = cost.shape
    padded = np.full((max(rows, columns), max(rows, columns)), np.inf)
    padded[:rows, :columns] = cost
    outcomes = []
    for order in permutations(range(len(padded))):
        made = [padded[row, column] for row, column in enumerate(order)]
        finite = [value for value in made if np.isfinite(value)]
        outcomes.append((-len(finite), sum(finite)))
    pairs, total = min(outcomes)
    return -pairs, total


@given(costs())
def test_it_is_the_best_of_all_assignments(cost):
    found = assign(cost)
    assert len(set(found.values())) == len(found), "each column at most once"
    total = sum(cost[row, column] for row, column in found.items())
    pairs, least = best(cost)
    assert len(found) == pairs
    assert total == pytest.approx(least)


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_is_assigned_to_nothing(shape):
    assert assign(np.zeros(shape)) == {}


MIDDLE = (29.0, 21.0, 35.0, 27.0)
SCREEN = (20.0, 14.0, 44.0, 34.0)


@pytest.fixture
def extractor(semantic_map) -> SightingExtractor:
    def size_of(category):
        return usual_sizes().get(semantic_map.catalogue.label(category))

    return SightingExtractor(LabelResolver(semantic_map, "object"), size_of, SETTINGS)


@pytest.fixture
def names(semantic_map):
    """Callable: sighting -> score by (detector, label)."""
    label = semantic_map.catalogue.label
    return lambda one: {(d, label(c)): pytest.approx(s) for (d, c), s in one.scores.items()}


def by(detector_labels, box=MIDDLE) -> Detections:
    """(detector, label, score) ... in one box, or (detector, label, score, box)."""
    rows = [(*row, box)[:4] for row in detector_labels]
    return Detections(
        np.array([row[3] for row in rows], dtype=np.float32),
        np.array([row[2] for row in rows], dtype=np.float32),
        tuple(row[1] for row in rows),
        tuple(row[0] for row in rows),
        tuple(dict.fromkeys(row[0] for row in rows)),
    )


def test_boxes_of_one_thing_by_several_detectors_are_one_sighting(extractor, make_frame, names):
    found = by([("a", "tv", 0.7), ("b", "tv", 0.5), ("b", "laptop", 0.4)], SCREEN)
    (one,) = extractor.sightings(make_frame(2.0), found)
    assert names(one) == {("a", "tv"): 0.7, ("b", "tv"): 0.5, ("b", "laptop"): 0.4}
    assert one.categories == {category for _, category in one.scores}
    assert one.p_map == pytest.approx([2, 0, 1], abs=0.05)


def test_boxes_apart_are_things_apart_strongest_first(extractor, make_frame, names):
    found = by([("a", "cup", 0.5, (5, 21, 11, 27)), ("a", "cup", 0.7, (45, 21, 51, 27))])
    strong, weak = extractor.sightings(make_frame(2.0), found)
    assert names(strong) == {("a", "cup"): 0.7} and names(weak) == {("a", "cup"): 0.5}
    assert strong.p_map[1] < 0 < weak.p_map[1]


def test_faint_and_unknown_detections_are_left_out(extractor, make_frame):
    found = by([("a", "cup", SETTINGS.min_score - 0.01), ("a", "warp core", 0.9)])
    assert extractor.sightings(make_frame(2.0), found) == []


def test_a_lit_screen_without_depth_stands_at_the_depth_of_its_frame(extractor, make_frame):
    depth = np.full((49, 65), 2.0)
    depth[14:34, 20:44] = np.nan
    (one,) = extractor.sightings(make_frame(depth), by([("a", "tv", 0.7)], SCREEN))
    assert one.p_map == pytest.approx([2, 0, 1], abs=0.1)
    assert extractor.unplaced == 0


@pytest.mark.parametrize("depth", [0.3, 6.0, np.nan])
def test_what_is_too_near_too_far_or_without_depth_is_unplaced(extractor, make_frame, depth):
    assert extractor.sightings(make_frame(depth), by([("a", "cup", 0.7)])) == []
    assert extractor.unplaced == 1


def test_extent_and_size_are_those_of_what_is_seen_at_its_depth(extractor, make_frame):
    depth = np.full((49, 65), 4.0)
    depth[16:32, 22:42] = np.random.default_rng(0).normal(2.0, 0.01, (16, 20))
    (one,) = extractor.sightings(make_frame(depth), by([("a", "tv", 0.7)], (22, 16, 42, 32)))
    assert one.size == pytest.approx(0.8, abs=0.05)  # 20 px at 2 m, focal length 50 px
    assert (one.high - one.low)[1:] == pytest.approx([0.75, 0.6], abs=0.1)
    assert one.p_map[0] == pytest.approx(2.0, abs=0.05), "the wall behind is not part of it"


@pytest.mark.parametrize(
    ("box", "cut"),
    [
        (MIDDLE, False),
        ((0, 21, 6, 27), True),
        ((58, 21, 64, 27), True),
        ((29, 0, 35, 6), True),
        ((29, 42, 35, 48), True),
    ],
)
def test_boxes_at_the_border_are_cut(extractor, make_frame, box, cut):
    (one,) = extractor.sightings(make_frame(2.0), by([("a", "cup", 0.7)], box))
    assert one.cut is cut


def test_a_position_without_a_depth_image_has_the_usual_size(extractor, semantic_map):
    cup = semantic_map.catalogue.find("cup").iri
    one = extractor.of_position(Sighting(cup, 0.7, np.array([1.0, 2.0, 3.0])))
    assert one.size == usual_sizes()["cup"].longest
    assert one.point and float((one.high - one.low).max()) < 0.05
    assert not one.cut


def test_intersection_over_union():
    assert intersection_over_union((0, 0, 2, 2), (0, 0, 2, 2)) == pytest.approx(1)
    assert intersection_over_union((0, 0, 2, 2), (1, 0, 3, 2)) == pytest.approx(1 / 3)
    assert intersection_over_union((0, 0, 1, 1), (2, 2, 3, 3)) == 0


def test_a_mask_says_which_depth_is_the_things(extractor, make_frame):
    depth = np.full((49, 65), 4.0)
    depth[20:25, 20:40] = 1.5  # a quarter of the box; the wall behind fills the rest
    box = np.array([[20, 10, 39, 29]], np.float32)
    mask = np.zeros((20, 20), bool)
    mask[10:16] = True  # and a row of the wall
    found = Detections(box, np.array([0.9], np.float32), ("chair",))
    (without,) = extractor.sightings(make_frame(depth), found)
    (within,) = extractor.sightings(make_frame(depth), replace(found, mask=(mask,)))
    assert without.depth == pytest.approx(4.0)
    assert within.depth == pytest.approx(1.5)
    assert within.box == without.box
