"""Sightings: detections of one frame grouped by thing and localised in its depth image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping.frames.sighting import Sighting
from mapping.labels.label_resolver import LabelResolver
from mapping.objects.existence import usual_sizes
from mapping.objects.settings import ObjectSettings
from mapping.objects.sightings import SightingExtractor, intersection_over_union
from perception.frames import Detections

SETTINGS = ObjectSettings()
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


def test_what_has_no_depth_around_it_either_is_counted_as_unplaced(extractor, make_frame):
    assert extractor.sightings(make_frame(np.nan), by([("a", "tv", 0.7)], SCREEN)) == []
    assert extractor.unplaced == 1


@pytest.mark.parametrize("depth", [0.3, 6.0])
def test_what_is_too_near_or_too_far_is_unplaced(extractor, make_frame, depth):
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
