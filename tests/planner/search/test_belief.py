"""Belief about where a target is: evidence becomes probabilities on cells of the floor."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kg.model.areas import Area
from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace
from planner.freespace.planning_map import PlanningMap
from planner.search.belief import CellBelief, TargetBelief, build_target_belief, site_weights
from planner.search.goals.candidate_queries import Candidate
from planner.settings import BeliefSettings

SETTINGS = BeliefSettings(uniform_share=0.0)
ROOMS = ("kitchen", "hall")


@cache
def home() -> FreeSpace:
    return free_space([Area(0, 4, 0, 4), Area(4, 8, 0, 4)])


def ground(seen: np.ndarray | None = None) -> PlanningMap:
    return PlanningMap(home(), ROOMS, ROOMS, seen=seen)


def candidate(kind: str, probability: float, **fields: object) -> Candidate:
    plain = Candidate(0, kind, "it", "it", np.array([1.0, 2.0]), probability, ())  # type: ignore[arg-type]
    return replace(plain, **fields)  # type: ignore[arg-type]


def belief(*candidates: Candidate, settings: BeliefSettings = SETTINGS) -> TargetBelief:
    return build_target_belief(ground(), home().inside(), candidates, settings)


def apart(cells: np.ndarray, weight: np.ndarray, target: np.ndarray) -> TargetBelief:
    """Belief of instances that do not learn from each other."""
    count = len(weight)
    alike = np.zeros((count, count), np.bool_)
    return TargetBelief(cells, weight, target, (), alike, np.zeros(count))


def of_room(weight: np.ndarray, room: int) -> float:
    return float(weight[home().room.reshape(-1)[home().inside()] == room].sum())


@pytest.mark.parametrize(("sigma", "spread"), [(0.5, 0.5), (0.0, home().cell / 2)])
def test_a_site_is_a_gaussian_about_its_position(sigma: float, spread: float) -> None:
    space, cells = home(), home().inside()
    middles = space.centres(cells)
    middle = int(np.argmin(np.hypot(*(middles - (2.0, 2.0)).T)))
    weight = site_weights(space, cells, middles[middle], sigma)
    assert weight.sum() == pytest.approx(1.0)
    for steps in (1, 2):
        aside = int(np.argmin(np.hypot(*(middles - middles[middle] - (steps * space.cell, 0)).T)))
        expected = math.exp(-((steps * space.cell / spread) ** 2) / 2)
        assert weight[aside] / weight[middle] == pytest.approx(expected)
    off = site_weights(space, cells, (-30.0, 2.0), 0.1)  # off the floor: the nearest cells
    assert off.sum() == pytest.approx(1.0)
    assert off @ middles[:, 0] == pytest.approx(middles[:, 0].min(), abs=0.05)


def test_weights_must_sum_to_one_with_what_is_absent() -> None:
    cells = home().inside()[:2]
    held = CellBelief(cells, np.array([0.1, 0.3]), 0.6)
    assert held.present == pytest.approx(0.4)
    for weight, absent in (([0.1, 0.3], 0.5), ([-0.1, 0.5], 0.6), ([0.5, 0.6], -0.1)):
        with pytest.raises(ValueError, match="sum to 1 with absent"):
            CellBelief(cells, np.array(weight), absent)


def test_a_known_object_is_where_it_was_or_where_it_may_have_been_carried() -> None:
    settings = replace(SETTINGS, p_same_room=0.75, p_left_floor=0.5, site_sigma=0.1)
    known = candidate("known", 0.5, existence=0.9, place="kitchen")
    other = candidate("place", 0.3, iri="hall", place="hall")
    made = belief(known, other, settings=settings)
    here, moved = (part for part in made.parts if part.candidate.iri == known.iri)
    # 0.4 is the probability that it was moved, half of that to where no cell is
    assert here.weight.sum() == pytest.approx(0.5)
    assert (here.candidate, moved.candidate.kind) == (known, "moved")
    assert moved.weight.sum() == pytest.approx(0.4 * 0.5)
    assert of_room(here.weight, 1) == 0.0
    assert of_room(moved.weight, 1) == pytest.approx(0.4 * 0.5 * 0.25)
    site = 0.5 * site_weights(home(), made.cells, known.p_map, 0.1)
    assert (here.weight >= site - 1e-12).all()


def test_a_room_shares_its_probability_with_what_the_target_is_found_near() -> None:
    settings = replace(SETTINGS, beside=0.6)
    room = candidate("place", 0.4, iri="kitchen", place="kitchen")
    table = candidate("nearby", 0.3, iri="table", place="kitchen", p_map=np.array([1.0, 1.0]))
    desk = replace(table, iri="desk", probability=0.1, p_map=np.array([3.0, 3.0]))
    made = belief(room, table, desk, settings=settings)
    shares = {part.candidate.iri: float(part.weight.sum()) for part in made.parts}
    assert shares == pytest.approx({"kitchen": 0.16, "table": 0.18, "desk": 0.06})
    assert made.weight.shape[0] == 1  # one instance


def test_a_target_is_less_likely_on_floor_where_it_would_have_been_noticed() -> None:
    cells = home().inside()
    seen = np.zeros(home().shape)
    seen.reshape(-1)[cells] = home().centres(cells)[:, 0] < 2.0
    room = candidate("place", 0.4, iri="kitchen", place="kitchen", noticed=0.75)
    made = build_target_belief(ground(seen), cells, [room], SETTINGS)
    inside = home().room.reshape(-1)[cells] == 0
    was_seen = seen.reshape(-1)[cells][inside] > 0
    weight = made.weight[0, inside]
    assert weight[was_seen] == pytest.approx(weight[~was_seen][0] / 4)
    assert weight.sum() == pytest.approx(0.4)
    spread = belief(room, settings=replace(SETTINGS, uniform_share=0.1))
    assert spread.weight.sum() == pytest.approx(0.4)
    assert spread.weight.min() == pytest.approx(0.04 / len(spread.cells))


def test_views_in_vain_lower_what_is_left_of_the_targets_together() -> None:
    cells = home().inside()[:4]
    weight = np.array([[0.5, 0.0, 0.0, 0.0], [0.0, 0.2, 0.2, 0.0], [0.0, 0.0, 0.0, 0.6]])
    made = apart(cells, weight, np.array([0, 0, 1]))
    unseen = np.array([0.5, 1.0, 0.0, 1.0])
    assert made.present(unseen) == pytest.approx([1 / 0.75, 1 / 0.8, 1.0])
    assert made.still_missing(unseen, 3) == pytest.approx([0.6, 1.0, 1.0])
    assert made.left(unseen, [0]) == pytest.approx(1 - (0.5 / 0.75) * (0.6 / 0.8))
    assert made.expected(unseen, np.array([1.0, 2.0])) == pytest.approx(
        [0.25 / 0.75, 0.2 / 0.8, 0.0, 1.2]
    )
    both = made.belief(unseen, [0, 1], 2)
    assert both.present == pytest.approx(1 - (0.5 / 0.75) * (0.6 / 0.8) * 0.4)
    assert made.belief(np.zeros(4), [0], 2).absent == 1.0


def bedrooms(*kinds: str, rooms: float = 4.0, p: float = 0.5) -> TargetBelief:
    """One candidate in each room of a home with rooms of `kinds`."""
    space = free_space([Area(4.0 * i, 4.0 * i + 3, 0, 3) for i in range(len(kinds))])
    names = tuple(f"room {i}" for i in range(len(kinds)))
    candidates = [
        replace(candidate("place", p, iri=name, place=name), room_kind=kind, rooms=rooms, facts=())
        for name, kind in zip(names, kinds, strict=True)
    ]
    settings = replace(SETTINGS, uniform_share=0.0)
    return build_target_belief(
        PlanningMap(space, names, names), space.inside(), candidates, settings
    )


def test_a_room_searched_in_vain_lowers_the_others_of_its_kind_alone() -> None:
    made = bedrooms("bedroom", "bedroom", "kitchen")
    unseen = 1.0 - 0.8 * (made.weight[0] > 0)
    left = made.weight @ made.expected(unseen, np.ones(1)) / (made.weight**2).sum(axis=1)
    assert left[1] == pytest.approx(4 / 4.8)
    assert left[2] == pytest.approx(1.0)
    assert made.left(unseen, [0]) == pytest.approx(1 - (0.5 / 0.6) * (1 - 0.5 * 4 / 4.8) * 0.5)


def test_rooms_of_a_kind_are_missed_together_as_often_as_their_distribution_says() -> None:
    made = bedrooms(*["bedroom"] * 6, rooms=3.0, p=0.4)
    theta = (np.arange(20000) + 0.5) / 20000
    density = theta ** (0.4 * 3 - 1) * (1 - theta) ** (0.6 * 3 - 1)
    for count in range(7):
        unseen = 1.0 - (made.weight[:count] > 0).any(axis=0)
        expected = (density * (1 - theta) ** count).sum() / density.sum()
        assert made.still_missing(unseen, 1)[0] == pytest.approx(expected, abs=1e-3)
