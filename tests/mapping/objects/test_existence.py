"""Existence and absence, by looks, sizes and rays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies
from kg.model.usual_sizes import VOXEL, UsualSize, unusual_scale, usual_sizes
from mapping.objects.absence import Absence
from mapping.objects.existence import (
    BEYOND,
    MANY,
    WORST,
    CategoryEvidence,
    VolumeView,
    beyond,
    category_probabilities,
    early,
    in_front,
    logit,
    ray_test,
    size_log_likelihood,
    strength,
    visibility,
)
from mapping.objects.settings import ObjectSettings
from mapping.persistence import departed, holds, learned_half_life, listed_half_life
from perception.inference.model_zoo import NETWORKS

odds = st.floats(-30, 30, allow_nan=False)
scores = st.floats(0, 1)


def existence(*hits: float, missed: float = 0.0, size: float = 0.0) -> float:
    """Existence after hits of these scores, each from a viewpoint of its own."""
    held = CategoryEvidence(sum(map(strength, hits)), float(len(hits)))
    return 1 / (1 + math.exp(-held.log_odds(missed, size)))


@given(st.floats(0, 1))
def test_the_log_odds_of_a_probability_are_its_own_within_bounds(p):
    assert 1 / (1 + math.exp(-logit(p))) == pytest.approx(min(max(p, 0.005), 0.995))


@given(scores, scores)
def test_a_higher_score_says_no_less(one, other):
    low, high = sorted((one, other))
    assert strength(low) <= strength(high)


@given(scores)
def test_one_look_never_makes_it_sure(score):
    assert existence(score) < 0.85


@given(st.lists(scores, min_size=1, max_size=20), st.floats(0.05, 1))
def test_every_hit_speaks_for_it_and_every_miss_against_it(hits, another):
    assert existence(*hits, another) > existence(*hits)
    assert existence(*hits, missed=1) < existence(*hits)


def test_ten_good_looks_make_it_near_certain_and_ten_faint_ones_do_not():
    assert existence(*[0.8] * 10) > 0.95
    assert existence(*[0.22] * 10) < 0.75


def test_a_false_detection_that_is_repeated_from_one_spot_stays_below_ten_looks_around():
    """Looks from one viewpoint count 1 / n."""
    weight = sum(1 / n for n in range(1, 1001))
    repeated = CategoryEvidence(weight * strength(0.3), weight)
    around = CategoryEvidence(10 * strength(0.5), 10.0)
    assert repeated.log_odds(0.0, 0.0) < around.log_odds(0.0, 0.0)


@given(st.floats(1e-3, 2), st.floats(1e-3, 2))
def test_a_miss_of_a_thing_that_looks_larger_says_more(one, other):
    small, large = sorted((one, other))
    assert 0 <= visibility(small) <= visibility(large) <= 1


@given(st.floats(-3.5, 20), st.floats(-4, 0))
def test_evidence_of_given_log_odds_has_them(log_odds, size):
    held = CategoryEvidence()
    held.set_log_odds(log_odds, size)
    assert held.strength >= 0
    assert held.log_odds(0.0, size) >= log_odds - 1e-9
    if held.strength > 0:
        assert held.log_odds(0.0, size) == pytest.approx(log_odds)


@given(st.lists(scores, max_size=5), st.lists(scores, max_size=5))
def test_merged_evidence_is_that_of_all_looks(one, other):
    merged = CategoryEvidence(sum(map(strength, one)), len(one))
    merged.merge(CategoryEvidence(sum(map(strength, other)), len(other)))
    assert merged.looks == len(one) + len(other)
    assert merged.strength == pytest.approx(sum(map(strength, [*one, *other])))


@given(st.dictionaries(st.text(max_size=3), odds, max_size=6))
def test_probabilities_leave_room_for_nothing_being_there(log_odds):
    found = category_probabilities(log_odds)
    assert found.keys() == log_odds.keys()
    assert all(0 <= share <= 1 for share in found.values())
    assert sum(found.values()) <= 1
    if max(log_odds.values(), default=0.0) < 20:
        assert sum(found.values()) < 1


@given(odds)
def test_a_single_category_is_as_probable_as_its_odds_say(one):
    assert category_probabilities({"cup": one})["cup"] == pytest.approx(1 / (1 + math.exp(-one)))


def test_equal_categories_share_what_is_sure():
    found = category_probabilities({"tv": 12.0, "laptop": 12.0})
    assert found["tv"] == found["laptop"] == pytest.approx(0.5, abs=1e-3)


DAY = 86400.0


def seen(hits: int, misses: int = 0) -> Absence:
    absence = Absence()
    for _ in range(misses):
        absence.miss(1.0, 0.6)
    for _ in range(hits):
        absence.hit(1.0)
    return absence


def test_without_a_view_nothing_is_known_to_have_left():
    assert seen(3).probability(0.2) == 0.0


def test_misses_of_what_is_seldom_detected_say_less():
    often, seldom = seen(8), seen(4, misses=8)
    for absence in (often, seldom):
        for _ in range(4):
            absence.miss(1.0, 0.6)
    assert often.probability(0.1) > 0.5 > seldom.probability(0.1)


def test_a_run_of_misses_saturates():
    absence = seen(2)
    steps = []
    for _ in range(10):
        before = absence.log_ratio
        absence.miss(1.0, 0.6)
        steps.append(absence.log_ratio - before)
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] < 0.3 < 0.6 < steps[0]


@given(st.integers(0, 500), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_however_often_it_was_detected_one_miss_at_most_doubles_the_odds_that_it_left(
    hits: int, recall: float, prior: float
):
    absence = seen(hits)
    absence.miss(1.0, recall)
    left = absence.probability(prior)
    assert 1 < left / (1 - left) / (prior / (1 - prior)) <= 2 + 1e-9


def test_a_hit_ends_the_doubt():
    absence = seen(3)
    absence.empty(1.0, 3.0)
    absence.miss(1.0, 0.8)
    absence.hit(1.0)
    assert absence.probability(0.2) == 0.0


def test_a_merged_thing_was_seen_when_either_was():
    lost, just_seen, doubted = seen(4), seen(2, misses=1), seen(3)
    for _ in range(5):
        lost.miss(1.0, 0.6)
    doubted.miss(1.0, 0.6)
    assert lost.probability(0.2) > doubted.probability(0.2) > 0
    lower, run = doubted.log_ratio, doubted.run
    doubted.merge(lost)
    assert (doubted.log_ratio, doubted.run) == (lower, run)
    lost.merge(just_seen)
    assert lost.probability(0.2) == 0.0
    assert lost == Absence(hits=6.0, misses=1.0)  # all views of both count from now on


def test_what_is_carried_leaves_sooner_than_what_is_fixed():
    cup, sink = listed_half_life("cup"), listed_half_life("sink")
    assert departed(sink, 0) < departed(cup, 0) == pytest.approx(0.02)
    assert departed(sink, DAY) < 0.01 < 0.1 < departed(cup, DAY) < 0.2


@given(st.floats(1, 1e9), st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_what_was_just_seen_holds_and_half_of_it_after_a_half_life(half_life, age, more):
    assert holds(half_life, half_life) == 0.5
    assert holds(half_life, min(age, 0.0)) == 1.0  # seen later than now, by another clock
    assert 0.0 <= holds(half_life, age + more) <= holds(half_life, age) <= 1.0


@given(st.floats(1, 1e7), st.lists(st.floats(-1e9, 1e9), max_size=5))
def test_a_stay_counts_up_to_twice_the_listed_half_life(listed, stays):
    learned = learned_half_life(listed, stays)
    assert listed * (1 - 1e-9) <= learned
    assert learned <= listed * (1 + 2 * math.log(2) * len(stays)) * (1 + 1e-9)
    assert learned == pytest.approx(learned_half_life(listed, [min(s, 2 * listed) for s in stays]))
    assert learned_half_life(listed, [listed]) == pytest.approx(listed * (1 + math.log(2)))


#: as the bundled detectors measured a real kitchen, in usual sizes
KITCHEN = {
    "chair": 0.52, "tv": 0.54, "bottle": 0.88, "cup": 0.9, "sink": 1.02, "book": 1.23,
    "dining table": 1.31,
}  # fmt: skip


def things(factor: float) -> list[tuple[str, float]]:
    return [(label, factor * r * usual_sizes()[label].longest) for label, r in KITCHEN.items()]


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_a_usual_room_is_told_nothing(factor):
    assert unusual_scale(things(factor)) is None


@pytest.mark.parametrize("factor", [0.1, 0.2, 5.0, 10.0])
def test_a_wrong_unit_is_told_with_its_factor(factor):
    found = unusual_scale(things(factor))
    assert found is not None
    assert found == pytest.approx(factor, rel=0.3)


def test_few_categories_tell_nothing():
    assert unusual_scale(things(10.0)[:3]) is None
    assert unusual_scale([("chair", 9.0)] * 20) is None
    assert unusual_scale([("chair", 0.0), ("unheard of", 50.0)]) is None


def test_one_large_category_does_not_decide():
    assert unusual_scale([*things(1.0), ("cup", 4.0), ("cup", 4.0), ("cup", 4.0)]) is None


size = st.floats(0.01, 20)
CUP = UsualSize(longest=0.1, width=0.08)


def test_every_label_of_the_bundled_detectors_has_a_size_and_is_a_category():
    labels = (NETWORKS / "labels_coco80.txt").read_text(encoding="utf-8").splitlines()
    assert set(labels) <= set(usual_sizes())
    catalogue = Catalogue.from_quads(load_ontologies().quads)
    for label in usual_sizes():
        assert catalogue.for_label(label, "object").label == label


def test_the_usual_size_is_the_likeliest():
    assert size_log_likelihood(0.1, CUP) == 0
    assert size_log_likelihood(0.2, CUP) < size_log_likelihood(0.12, CUP) < 0
    assert size_log_likelihood(0.05, CUP) > size_log_likelihood(0.2, CUP), "a part is in view"


@given(size)
def test_an_unlikely_size_costs_so_much_and_no_more(size):
    assert WORST <= size_log_likelihood(size, CUP) <= 0


@pytest.mark.parametrize(("measured", "usual"), [(0.3, None), (0.0, CUP)])
def test_what_is_not_known_says_nothing(measured, usual):
    assert size_log_likelihood(measured, usual) == 0
    assert beyond((9.0, 9.0, 9.0), usual) == beyond((), CUP) == 0, "no largest one is known"


def test_the_largest_things_are_no_smaller_than_the_usual_ones():
    for name, one in usual_sizes().items():
        long, middle, short = one.greatest
        assert long >= one.longest and middle >= one.width and long >= middle >= short > 0, name


BOOK = UsualSize(longest=0.22, width=0.077, greatest=(0.45, 0.35, 0.22))


@pytest.mark.parametrize("sides", [(0.48, 0.38, 0.25), (0.48, 0.02, 0.02), (0.05, 0.05, 0.02)])
def test_a_box_of_any_book_or_of_a_part_of_one_says_nothing_against_a_book(sides):
    assert beyond(sides, BOOK) == 0


def test_one_side_beyond_the_largest_speaks_against_a_name():
    fits = [beyond(sides, BOOK) for sides in ((0.1, 0.53, 0.2), (0.95, 0.86, 0.7))]
    assert fits[0] == pytest.approx(-math.log(0.53 / (0.45 + VOXEL)) / BEYOND)
    assert fits[1] == WORST


@pytest.mark.parametrize(("sides", "size"), [((0.63, 0.63, 0.7), 0.9), ((), 0.7)])
def test_what_is_shorter_than_half_a_bed_is_hardly_one(sides, size):
    usual = usual_sizes()
    assert beyond(sides, usual["bed"], size) == pytest.approx(-math.log(1.0 / 0.7) / BEYOND)
    assert beyond((1.1, 0.9, 0.4), usual["bed"], 0.7) == 0, "its box shows more than one view"
    for seen_in_part in ("chair", "tv", "person"):
        assert beyond((0.2, 0.2, 0.1), usual[seen_in_part], 0.2) == 0
    assert beyond((), usual["bed"]) == 0, "nothing is known"


def test_things_are_likelier_while_a_run_has_looked_from_few_viewpoints():
    gained = [early(viewpoints) for viewpoints in (1, 3, 10, MANY - 1, MANY, 1000)]
    assert gained == sorted(gained, reverse=True)
    assert gained[0] == pytest.approx(1.05, abs=0.01)
    assert gained[-2:] == [0, 0] == [early(0), early(0)], "nothing is known of the run"


SETTINGS = ObjectSettings()
AHEAD = np.array([2.0, 0.0, 1.0])  # on the optical axis
SIZE = 0.3


def seen_volume(frame, p_map=AHEAD, size=SIZE):
    return ray_test(frame, np.asarray(p_map, dtype=np.float64), size, SETTINGS)


@pytest.mark.parametrize(
    ("depth", "expected"),
    [
        (2.0, VolumeView.SURFACE),
        (2.2, VolumeView.SURFACE),  # its far side
        (4.0, VolumeView.EMPTY),
        (1.0, VolumeView.NOTHING),  # hidden
        (np.nan, VolumeView.NOTHING),  # no return
        (0.0, VolumeView.NOTHING),
    ],
)
def test_rays_end_inside_go_through_or_tell_nothing(make_frame, depth, expected):
    assert seen_volume(make_frame(depth)) is expected


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("axis", "far"), [(1, 1.25), (2, 0.9)])
def test_a_volume_that_the_border_cuts_is_not_judged(make_frame, axis, far, side):
    """32 columns and 24 rows of 50 px focal length: 1.28 m and 0.96 m at 2 m."""
    cut, whole = AHEAD.copy(), AHEAD.copy()
    cut[axis] += side * far
    whole[axis] += side * far / 2
    assert seen_volume(make_frame(4.0), cut) is VolumeView.NOTHING
    assert seen_volume(make_frame(4.0), whole) is VolumeView.EMPTY


def test_a_volume_that_is_partly_hidden_is_not_judged(make_frame):
    depth = np.full((49, 65), 4.0)
    depth[:, :33] = 1.0  # something stands before its left half
    assert seen_volume(make_frame(depth)) is VolumeView.NOTHING


def test_a_thing_that_covers_half_the_volume_leaves_a_surface(make_frame):
    depth = np.full((49, 65), 4.0)
    depth[:, :33] = 2.0
    assert seen_volume(make_frame(depth)) is VolumeView.SURFACE


def test_what_is_in_front_is_in_the_image_and_in_range(make_frame):
    s = SETTINGS
    positions = {
        "ahead": (2.0, 0.0, 1.0),
        "near the border": (2.0, 1.2, 1.0),
        "left of the image": (2.0, 1.4, 1.0),
        "below the image": (2.0, 0.0, -0.1),
        "behind": (-2.0, 0.0, 1.0),
        "in the camera": (0.0, 0.0, 1.0),
        "too near": (s.nearest_sight - 0.1, 0.0, 1.0),
        "too far": (s.farthest_sight + 0.1, 0.0, 1.0),
    }
    found = in_front(make_frame(2.0), np.array([*positions.values()]), s)
    assert [list(positions)[index] for index in found] == ["ahead", "near the border"]
    assert len(in_front(make_frame(2.0), np.zeros((0, 3)), s)) == 0
