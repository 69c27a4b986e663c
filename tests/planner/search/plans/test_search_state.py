"""What a hunt makes of looks in vain: Bayes' rule, fresh positions, and when it gives up."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.search.room_beliefs import room_weights
from kg.model.areas import Area
from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace, visible_cells
from planner.freespace.planning_map import PlanningMap
from planner.search.belief import TargetBelief, site_weights
from planner.search.goals.targets import Target
from planner.search.plans.search_state import PlanningState
from planner.search.viewpoints.candidate_views import CandidateViews, Sensor, candidate_views
from planner.search.viewpoints.covering_viewpoints import (
    COVER,
    covering_viewpoints,
    room_viewpoints,
)
from planner.search.viewpoints.next_best_view import RevisitModel, RobotState
from planner.settings import BeliefSettings
from tests.planner.search.test_belief import apart

quick = settings(max_examples=30, deadline=None)


@cache
def home() -> FreeSpace:
    return free_space([Area(0, 5, 0, 4), Area(5, 8, 0, 4), Area(0, 8, 4, 5.4)])


@cache
def views() -> CandidateViews:
    return candidate_views(home(), Sensor(far=3.0))


def one_thing(weight: np.ndarray) -> TargetBelief:
    return apart(views().cells, weight[None, :], np.zeros(1, np.intp))


def state(belief, weight=None, among=None):
    among = among or views()
    space, cells = among.space, among.cells
    names = ("",) * (int(space.room.max()) + 1)
    if weight is None:
        weight = 0.9 * room_weights(space, cells, {0: 0.8, 1: 0.15, 2: 0.05})
    known = apart(cells, weight[None, :], np.zeros(1, np.intp))
    it = Target("it", "it", None, {}, {})
    return PlanningState((it,), PlanningMap(space, names, names), among, (), known, belief)


def searched_in_vain(one: PlanningState) -> list[int]:
    """Cells looked from until it is given up."""
    at, cells = RobotState(int(one.space.floor()[0])), []
    while (view := one.next_view(at)) is not None:
        at = one.next_best_view.after(at, view)
        cells.append(at.cell)
        one.missed(view)
        assert len(cells) < 2000
    return cells


@quick
@given(st.integers(0, 10**6), st.floats(0.1, 1.0), st.data())
def test_belief_keeps_its_mass_through_looks_in_vain(seed, present, data):
    weight = np.random.default_rng(seed).random(len(views().cells)) ** 4
    known, unseen = one_thing(weight / weight.sum() * present), np.ones(len(weight))
    for view in data.draw(st.lists(st.integers(0, len(views().viewpoint) - 1), max_size=6)):
        before = known.belief(unseen, [0], 1)
        unseen = unseen * (1 - views().chance[view])
        after, shown = known.belief(unseen, [0], 1), views().chance[view] > 0
        assert after.weight.sum() + after.absent == pytest.approx(1)
        assert after.absent >= before.absent - 1e-12
        assert (after.weight[~shown] >= before.weight[~shown] - 1e-12).all()
        assert after.weight[shown].sum() <= before.weight[shown].sum() + 1e-12


def test_a_remembered_site_and_its_room_are_one_belief() -> None:
    cells = views().cells
    site = site_weights(home(), cells, (1.0, 1.0), 0.3)
    weight = site + room_weights(home(), cells, {0: 1.0})
    known, unseen = one_thing(0.9 * weight / weight.sum()), np.ones(len(cells))
    before = known.belief(unseen, [0], 1)
    near = site > site.max() / 10
    after = known.belief(np.where(near, 0.1, 1.0), [0], 1)
    in_room = home().room.reshape(-1)[cells] == 0
    assert after.weight[in_room].sum() < before.weight[in_room].sum()
    assert after.weight[~near].sum() > before.weight[~near].sum()


def test_a_search_in_vain_goes_on_from_fresh_positions_until_little_was_overlooked() -> None:
    hasty, patient = state(BeliefSettings(stop_below=0.1)), state(BeliefSettings())
    begun, total = searched_in_vain(hasty), searched_in_vain(patient)
    assert total[: len(begun)] == begun
    assert len(begun) < len(total)
    assert set(views().viewpoints) < set(patient.views.viewpoints)
    assert not set(total) <= set(views().viewpoints.tolist())
    assert hasty.overlooked <= 0.1
    assert patient.overlooked <= BeliefSettings().stop_below < hasty.overlooked


def test_a_belief_that_misleads_does_not_end_a_search() -> None:
    weight = 0.89 * room_weights(home(), views().cells, {0: 1.0}) + 0.01 / len(views().cells)
    misled = state(BeliefSettings(stop_below=0.0005), weight)
    searched_in_vain(misled)
    elsewhere = home().room.reshape(-1)[views().cells] != 0
    seen = misled.next_best_view.seeable & elsewhere
    assert misled.unseen[seen].mean() < 0.01 and misled.overlooked <= 0.0005


def test_floor_that_is_cut_off_keeps_nobody_looking_at_the_rest() -> None:
    shut = state(BeliefSettings())
    edge = np.abs(home().centres(home().inside())[:, 1] - 4.0) < 0.5  # before and behind the wall
    shut.blocked(home().inside()[edge])
    taken = searched_in_vain(shut)
    at = RobotState(int(home().floor()[0]))
    seen = shut.next_best_view.seeable_from(at)
    assert 0 < seen.mean() < 1
    assert np.isfinite(
        shut.views.ways.metres_from(at.cell)[np.isin(shut.views.viewpoints, taken)]
    ).all()
    assert shut.unseen[seen].mean() <= BeliefSettings().stop_below < shut.overlooked


def test_what_was_looked_at_is_remembered_among_other_positions() -> None:
    revisits = RevisitModel(views())
    for view in (3, 3, 40):
        revisits.add(view)
    fewer = views().with_viewpoints(home(), views().viewpoints[1:])
    weight = np.ones(len(views().cells))
    kept = views().viewpoint >= 1
    before = revisits.gains(weight)[kept]
    assert revisits.moved_to(fewer).gains(weight) == pytest.approx(before)
    assert (
        before[40 - int((~kept).sum())] < RevisitModel(fewer).gains(weight)[40 - int((~kept).sum())]
    )


def test_a_closet_that_is_seen_from_no_lattice_position_is_looked_into() -> None:
    space = free_space([Area(0, 5, 0, 4), Area(5, 6.2, 1.4, 2.2)])
    reach, near = 4.6, 0.8
    covers = room_viewpoints(space, reach, near=near, cover=0.995, covers=2)
    assert _seen(space, sorted({int(c) for cells in covers.values() for c in cells})) < 0.2
    assert _seen(space, covering_viewpoints(space, reach, near=near).tolist()) > 0.8


@pytest.mark.parametrize("reach", [2.0, 3.0, 4.6])
def test_every_room_is_seen_from_two_viewpoints(reach: float) -> None:
    times = np.zeros(home().room.size, np.intp)
    for viewpoint in covering_viewpoints(home(), reach, near=0.8):
        cells, offset = visible_cells(home(), int(viewpoint), reach)
        times[cells[np.hypot(*offset.T) >= 0.8]] += 1
    for room in range(3):
        assert (times[home().inside(room)] >= 1).mean() >= COVER
        assert (times[home().inside(room)] >= 2).mean() >= COVER


def _seen(space: FreeSpace, viewpoints: list[int]) -> float:
    """Share of the closet that is seen from `viewpoints`."""
    shown: set[int] = set()
    for viewpoint in viewpoints:
        cells, offset = visible_cells(space, viewpoint, 4.6)
        shown.update(cells[np.hypot(*offset.T) >= 0.8].tolist())
    closet = space.floor(1).tolist()
    return len(shown.intersection(closet)) / len(closet)
