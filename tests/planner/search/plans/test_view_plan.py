"""What `find` promises: candidates of the graph, belief on cells, plans of looks, bounds."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError
from kg.model.records import MapUpdate
from kg.serving.opening import in_memory_map
from mapping.persistence import (
    HALF_LIVES,
    holds,
    learned_half_life,
    listed_half_life,
    mobility_table,
)
from planner.search.goals.targets import resolve
from planner.search.plans.report import plan_json, step_lines
from planner.search.plans.search_state import PlanningState, build_search
from planner.search.plans.view_plan import plan
from planner.search.viewpoints.candidate_views import Sensor
from planner.settings import BELIEF
from tests.planner.flat import fill, thing

DAY = 86400.0


@pytest.fixture(scope="module")
def flat() -> SemanticMap:
    """A flat that no test changes."""
    return fill(in_memory_map(title="flat"))


def state_for(semantic_map: SemanticMap, *targets: str, at: float | None = None) -> PlanningState:
    state = build_search(semantic_map, targets, at=at)
    assert state is not None
    return state


def test_a_remembered_object_is_looked_for_where_it_was_seen(flat: SemanticMap) -> None:
    found = plan(state_for(flat, "mug"), (6.0, 1.0), time_limit=math.inf)
    first = found.steps[0]
    assert first.why[0].candidate.kind == "known"
    assert "cup" in first.why[0].candidate.facts[0]
    assert first.why[0].candidate.place == flat.place_iri(1)
    assert 0 < first.probability < first.why[0].candidate.probability


def test_what_is_kept_near_a_known_object_is_looked_for_there(flat: SemanticMap) -> None:
    found = plan(state_for(flat, "apple"), (6.0, 1.0), time_limit=math.inf)
    assert found.steps[0].why[0].candidate.kind == "nearby"
    assert any("found near banana" in fact for fact in found.steps[0].why[0].candidate.facts)


def test_every_place_is_a_candidate_also_one_nobody_has_seen(flat: SemanticMap) -> None:
    state = state_for(flat, "cup")
    places = {c.place: c.probability for c in state.candidates if c.kind == "place"}
    assert set(places) == {flat.place_iri(n) for n in (1, 2, 3)}
    assert all(0 < p < 1 for p in places.values())
    assert places[flat.place_iri(1)] > places[flat.place_iri(2)]  # kitchens hold cups


def test_a_memory_of_a_cup_fades_and_one_of_a_bed_does_not(flat: SemanticMap) -> None:
    def known(target: str, at: float) -> float:
        candidates = state_for(flat, target, at=at).candidates
        return max(c.probability for c in candidates if c.kind == "known")

    assert known("cup", 0.0) == pytest.approx(0.9)
    assert known("cup", 3 * DAY) < 0.05
    assert known("bed", 3 * DAY) > 0.89


def test_what_views_of_a_room_tell_fades_as_the_memory_of_its_things(flat: SemanticMap) -> None:
    def at(time: float) -> tuple[float, float, float]:
        candidates = state_for(flat, "cup", at=time).candidates
        known = max(c.probability for c in candidates if c.kind == "known")
        (room,) = (c for c in candidates if (c.kind, c.iri) == ("place", flat.place_iri(1)))
        return known, room.noticed, room.probability

    (known, noticed, viewed), never = at(0.0), at(3000 * DAY)
    assert noticed == BELIEF.noticed and viewed < never[2]
    for age in (0.1 * DAY, 0.5 * DAY, 2 * DAY):
        later = at(age)
        kept = later[0] / known
        assert later[1] == pytest.approx(BELIEF.noticed * kept)
        assert later[2] == pytest.approx(never[2] + (viewed - never[2]) * kept)


def test_a_faded_memory_leaves_its_room_likelier_than_others(flat: SemanticMap) -> None:
    state = state_for(flat, "cup", at=3 * DAY)
    _, site = state.target_belief.parts[:2]
    assert site.candidate.kind == "moved"
    rooms = state.space.room.reshape(-1)[state.target_belief.cells]
    by_room = np.bincount(rooms, site.weight)
    assert by_room[0] > by_room[1] > 0
    assert 0.5 < site.weight.sum() < 0.9  # some of it left the floor


def test_site_and_room_are_the_same_cells(flat: SemanticMap) -> None:
    """A miss at the site lowers the instance in its whole room, by Bayes' rule on one sum."""
    state = state_for(flat, "cup")
    before = state.belief
    assert before.weight.sum() + before.absent == pytest.approx(1.0)
    view = state.next_view(state.robot_state((6.0, 1.0)))
    assert view is not None
    chance = state.revisits.chance(view)
    rows = state.target_belief.weight
    expected = 1 - np.prod([(1 - row.sum()) / (1 - row @ chance) for row in rows])
    state.missed(view)
    assert state.left == pytest.approx(expected)
    assert state.left < before.present


def test_a_hunt_goes_on_until_nothing_is_worth_a_look(flat: SemanticMap) -> None:
    state, at = state_for(flat, "banana"), None
    at = state.robot_state((6.0, 1.0))
    left = [state.left]
    for _ in range(200):
        view = state.next_view(at)
        if view is None:
            break
        state.missed(view)
        at = state.next_best_view.after(at, view)
        left.append(state.left)
    else:
        pytest.fail("the hunt never gives up")
    assert len(left) > 3
    assert all(b < a for a, b in pairwise(left))
    assert left[-1] < 0.5 * left[0]


def test_pictures_on_the_way_teach_less_and_less(flat: SemanticMap) -> None:
    state = state_for(flat, "cup")
    cell = state.space.nearest((1.0, 1.0))
    steps = []
    for _ in range(3):
        before = state.left
        state.missed_sweep(cell, 0.0, state.views.sensor.field_of_view)
        steps.append(before - state.left)
    assert steps[0] > 2 * steps[1] > 4 * steps[2] >= 0


def test_a_blocked_door_leaves_what_was_learned(flat: SemanticMap) -> None:
    state = state_for(flat, "cup")
    at = state.robot_state((6.0, 1.0))
    view = state.next_view(at)
    assert view is not None
    state.missed(view)
    left = state.left
    centres = state.space.centres(state.space.floor())
    door = state.space.floor()[np.abs(centres[:, 0] - 4.0) < 0.35]
    state.blocked(door)
    assert state.left == pytest.approx(left)
    following = state.next_view(state.robot_state((6.0, 1.0)))
    assert following is not None
    x, _ = state.space.centres([state.views.viewpoints[state.views.viewpoint[following]]])[0]
    assert x > 4.0  # the kitchen cannot be reached any more


def test_all_of_several_targets_are_wanted_until_each_is_found(flat: SemanticMap) -> None:
    state = state_for(flat, "cup", "bed")
    found = plan(state, (6.0, 1.0), time_limit=math.inf)
    assert found.targets == ("cup", "bed")
    assert 1.0 < found.finds <= 2.0
    assert all(0 <= p <= 1 for p in (found.probability, *(s.probability for s in found.steps)))
    assert all(0 <= step.left <= 1 for step in found.steps)
    state.found("bed", (7.0, 2.0))
    assert state.wanted == (0,)
    after = plan(state, (6.0, 1.0), time_limit=math.inf)
    assert after.targets == ("cup",)
    assert {r.target for step in after.steps for r in step.why} == {"cup"}
    state.found("cup", (3.0, 1.0))
    assert (state.left, state.next_view(state.robot_state((6.0, 1.0)))) == (0.0, None)


def test_needs_are_met_by_what_is_used_for_them() -> None:
    flat = fill(in_memory_map())
    needs = {
        "something to drink from": {"bottle", "wine glass", "cup"},
        "Anything to sit on": {"chair", "couch", "bench", "bed", "toilet"},
        "something to cut with": {"knife", "scissors"},
        "something to tell the time": {"clock", "cell phone"},
    }
    found = {target.text: set(target.kinds.values()) for target in resolve(flat, list(needs))}
    assert found == needs
    assert len(resolve(flat, ["cup", "mug", "cups"])) == 1
    flat.update(
        "INSERT DATA { GRAPH graph:ontology { here:Book here:usedFor 'stand on' } }",
        allow=("ontology",),
    )
    assert set(resolve(flat, ["something to stand on"])[0].kinds.values()) == {"book"}
    with pytest.raises(UnknownCategoryError, match=r"'fly with'.* drink from"):
        resolve(flat, ["something to fly with"])


def test_plans_are_the_same_every_time(flat: SemanticMap) -> None:
    plans = [
        plan_json(plan(state_for(flat, "apple", "cup"), (6.0, 1.0), seed=4, time_limit=math.inf))
        for _ in range(2)
    ]
    assert plans[0] == plans[1]


def test_a_budget_ends_the_plan(flat: SemanticMap) -> None:
    whole = plan(state_for(flat, "cup"), (6.0, 1.0), time_limit=math.inf)
    part = plan(state_for(flat, "cup"), (6.0, 1.0), budget=60.0, time_limit=math.inf)
    assert 0 < len(part.steps) < len(whole.steps)
    assert part.steps[-1].seconds <= 60.0


def test_what_is_on_the_steps_adds_up(flat: SemanticMap) -> None:
    state = state_for(flat, "apple")
    found = plan(state, (6.0, 1.0), time_limit=math.inf)
    p = np.array([step.probability for step in found.steps])
    seconds = np.array([step.seconds for step in found.steps])
    assert found.probability == pytest.approx(p.sum())
    assert found.expected_seconds == pytest.approx(p @ seconds / p.sum())
    assert seconds == pytest.approx(np.cumsum([step.cost for step in found.steps]))
    left = [step.left for step in found.steps]
    assert left == pytest.approx(found.present - np.cumsum(p), abs=1e-9)


def test_an_object_in_no_place_is_looked_for_around_itself() -> None:
    semantic_map = in_memory_map()
    semantic_map.apply(MapUpdate(objects=(thing(semantic_map, "cup", 2.0, 2.0, None),)))
    state = state_for(semantic_map, "cup")
    assert state.rooms == ("",)
    assert plan(state, (0.0, 0.0), time_limit=math.inf).probability > 0.5
    assert build_search(in_memory_map(), ["cup"]) is None


def test_a_better_sensor_finds_more_sooner(flat: SemanticMap) -> None:
    def expected(recall: float) -> float:
        state = build_search(flat, ["cup"], sensor=Sensor(recall=recall))
        assert state is not None
        return plan(state, (6.0, 1.0), time_limit=math.inf).steps[0].probability

    assert expected(0.95) > expected(0.5)


def test_half_lives_are_listed_for_known_labels_and_learned_from_stays(flat: SemanticMap) -> None:
    labels = {c.label for c in flat.catalogue.categories}
    assert set(mobility_table()) <= labels
    assert set(mobility_table().values()) <= set(HALF_LIVES)
    assert listed_half_life("refrigerator") > listed_half_life("chair") > listed_half_life("cup")
    assert listed_half_life("mug", ["mug", "cup", "object"]) == listed_half_life("cup")
    assert learned_half_life(100.0, []) == pytest.approx(100.0)
    assert 100.0 < learned_half_life(100.0, [50.0]) < learned_half_life(100.0, [50.0, 150.0])
    assert holds(100.0, 100.0) == pytest.approx(0.5)
    assert holds(100.0, -5.0) == 1.0


def test_the_printed_reasons_of_a_step_are_all_that_it_has(flat: SemanticMap) -> None:
    """The last line of reasons has the sum of those that are not listed."""
    words = ("cup", "apple", "banana", "book", "bottle", "bowl", "remote")
    steps = plan(state_for(flat, *words), (6.0, 1.0), time_limit=math.inf).steps
    assert max(len(step.why) for step in steps) > 7
    for step in steps:
        lines = [re.match(r" +([0-9.]+) %", line) for line in step_lines([step])]
        printed = [float(match[1]) for match in lines if match]
        rounded = sum(0.5 if one >= 9.5 else 0.06 for one in printed)
        whole = 100 * sum(reason.probability for reason in step.why)
        assert sum(printed) == pytest.approx(whole, abs=rounded)
