"""Candidate views, and the next best one."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.model.areas import Area
from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    Motion,
    Sensor,
    angle_between,
    belief_cells,
    candidate_views,
    floor_in_view,
    square,
    sweep_chance,
    sweep_over,
)
from planner.search.viewpoints.next_best_view import NextBestView, RevisitModel, RobotState

quick = settings(max_examples=30, deadline=None)
angles = st.floats(-10.0, 10.0)


@cache
def home() -> FreeSpace:
    return free_space([Area(0, 5, 0, 4), Area(5, 8, 0, 4), Area(0, 8, 4, 5.4)])


@cache
def views() -> CandidateViews:
    return candidate_views(home(), Sensor(far=3.0, recall=0.7))


weights = st.integers(0, 10**6).map(
    lambda seed: np.random.default_rng(seed).random(len(views().cells)) ** 4
)


def test_a_second_look_from_the_same_place_is_worth_less() -> None:
    weight = np.full(len(views().cells), 1 / len(views().cells))
    revisits = RevisitModel(views())
    before = revisits.gains(weight)
    view = int(np.argmax(before))
    assert before == pytest.approx(views().chance @ weight, rel=1e-4)
    revisits.add(view)
    after = revisits.gains(weight)
    assert after[view] == pytest.approx(0.2 * before[view], rel=1e-3)  # 1 - rho
    squares = np.array([square(home(), cell) for cell in views().viewpoints])[views().viewpoint]
    elsewhere = squares != squares[view]
    assert elsewhere.any()
    assert after[elsewhere] == pytest.approx(before[elsewhere])
    assert revisits.chance(view).sum() == pytest.approx(0.2 * views().chance[view].sum(), rel=1e-3)


@quick
@given(weights, st.integers(0, 10**6), st.integers(0, 2))
def test_no_room_with_a_better_walk_is_left_out(weight: np.ndarray, cell: int, likely: int) -> None:
    one, none = NextBestView(views()), RevisitModel(views())
    weight = np.where(home().room.reshape(-1)[views().cells] == likely, weight, weight / 9)
    floor = home().floor()
    at = RobotState(int(floor[cell % len(floor)]))
    costs = one.costs(at, np.arange(len(views().viewpoint)))
    rate = none.gains(weight) / costs
    walks = {}
    for room in one._rooms:
        number = int(np.argmax(rate[room.rows]))
        view = int(room.rows[number])
        seconds = float(costs[view])
        walks[view] = one._lookahead_rate(at, weight, room, number, seconds, none)
    best = int(np.argmax(rate))
    assert one.best(at, weight) == max(walks, key=lambda v: (walks[v], v == best))


@pytest.mark.parametrize("wrong", [{"near": 5.0}, {"recall": 0.0}, {"rho": 1.5}])
def test_what_no_camera_can_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"must lie|needs"):
        Sensor(**wrong)
    with pytest.raises(ValueError, match="speed"):
        Motion(speed=0.0)


@quick
@given(angles, angles, st.floats(0.3, 6.2), st.floats(0.3, 1.2))
def test_a_sweep_shows_all_that_was_asked_for_and_what_it_turns_past(
    at: float, heading: float, extent: float, field_of_view: float
) -> None:
    extent = max(extent, field_of_view)
    sweep = sweep_over(at, heading, extent, field_of_view)
    ends = heading + np.array([-0.5, 0.0, 0.5]) * extent
    assert (angle_between(ends, sweep.middle) <= sweep.extent / 2 + 1e-6).all()
    half = (extent - field_of_view) / 2
    nearer = min(angle_between(at, heading - half), angle_between(at, heading + half))
    turned = angle_between(at, sweep.start) + abs(sweep.turn)
    assert turned == pytest.approx(float(nearer) + 2 * half, abs=1e-6)
    assert sweep.extent >= min(abs(sweep.turn) + field_of_view, 2 * np.pi) - 1e-6


SENSOR = Sensor(near=0.5, far=2.5, field_of_view=1.0)
MOTION = Motion(speed=0.5, turn_rate=0.8, picture=2.0)


@cache
def den() -> FreeSpace:
    return free_space([Area(0, 6, 0, 4), Area(6, 9, 0, 4)])


@cache
def shots() -> CandidateViews:
    return candidate_views(den(), SENSOR, MOTION)


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_a_sweep_shows_the_floor_within_its_range_and_angle(heading: float) -> None:
    space, at = den(), den().nearest((3.0, 2.0), 0)
    view = floor_in_view(space, SENSOR, at, heading, 1.2)
    x, y = (space.centres(space.inside(0)) - space.centres([at])[0]).T
    metres, bearing = np.hypot(x, y), np.arctan2(y, x)
    aside = np.abs((bearing - heading + np.pi) % (2 * np.pi) - np.pi)
    # sight reaches as far as whole cells do
    expected = (metres >= 0.5) & (metres <= 2.4 + 1e-9) & (aside <= 0.6)
    shown = {tuple(p) for p in view.p_map.round(6).tolist()}
    assert shown == {tuple(p) for p in space.centres(space.inside(0)[expected]).round(6).tolist()}
    assert view.metres == pytest.approx(np.hypot(*(view.p_map - space.centres([at])[0]).T))
    assert view.cell == space.cell


def test_a_view_detects_what_its_sweep_shows() -> None:
    for number in range(0, len(shots().viewpoint), 5):
        at = int(shots().viewpoints[shots().viewpoint[number]])
        heading, extent = float(shots().heading[number]), float(shots().extent[number])
        shown = floor_in_view(den(), SENSOR, at, heading, extent)
        found = den().centres(shots().cells[shots().chance[number] > 0])
        assert sorted(map(tuple, found.round(6).tolist())) == sorted(
            map(tuple, shown.p_map.round(6).tolist())
        )
        told = sweep_chance(shots(), at, heading, extent)
        assert np.array_equal(told, shots().chance[number])
    shut = free_space([Area(0, 4, 0, 4), Area(4, 8, 0, 4)], doors=[])
    blocked = candidate_views(shut, Sensor(), viewpoints=np.array([shut.nearest((2, 2), 0)]))
    rooms = shut.room.reshape(-1)[blocked.cells]
    assert not blocked.chance.any()[rooms == 1].any() and blocked.chance.any()[rooms == 0].any()


def test_a_belief_of_few_cells_has_some_in_every_room() -> None:
    space = free_space([Area(0, 20, 0, 20), Area(20, 20.7, 0, 0.7)])
    few = belief_cells(space)
    assert len(space.inside()) / 5 < len(few) < len(space.inside()) / 3
    assert set(space.room.reshape(-1)[few].tolist()) == {0, 1}
    assert np.isin(few, space.inside()).all()
    assert np.array_equal(belief_cells(den()), den().inside())


def test_squares_have_sides_of_a_metre() -> None:
    middles = den().origin + np.array([[0.1, 0.1], [0.9, 0.9], [1.1, 0.9], [0.9, 1.1]])
    cells = [
        int(np.argmin(((den().centres(np.arange(den().room.size)) - p) ** 2).sum(axis=1)))
        for p in middles
    ]
    assert len({square(den(), cell) for cell in cells}) == 3
    assert square(den(), cells[0]) == square(den(), cells[1])


def test_a_view_costs_the_way_the_turn_and_the_sweep() -> None:
    heading, wide = math.pi / 2, 2 * math.pi / 3
    spots = [den().nearest((x, 2.1), 0) for x in (1.1, 3.1)]
    made = candidate_views(den(), SENSOR, MOTION, viewpoints=np.array(spots))
    best, at = NextBestView(made), RobotState(spots[0], heading=heading)

    def number(viewpoint: int, extent: float) -> int:
        same = np.isclose(made.extent, extent) & (made.viewpoint == viewpoint)
        turned = np.isclose(made.heading, heading) | np.isclose(extent, 2 * math.pi)
        (found,) = np.flatnonzero(same & turned)
        return int(found)

    def cost(viewpoint: int, extent: float) -> float:
        return float(best.costs(at, np.array([number(viewpoint, extent)]))[0])

    side = (wide - 1.0) / 2  # from the heading to where a sweep begins or ends
    assert cost(0, 1.0) == pytest.approx(2.0)
    assert cost(0, wide) == pytest.approx(side / 0.8 + 2.0 + 2 * side / 0.8)
    assert cost(0, 2 * math.pi) == pytest.approx(2.0 + 2 * math.pi / 0.8)
    way = 2.0 / 0.5  # along x, from where it turns to the nearer end of the sweep
    assert cost(1, 1.0) == pytest.approx(way + heading / 0.8 + 2.0)
    assert cost(1, wide) == pytest.approx(way + (heading - side) / 0.8 + 2.0 + 2 * side / 0.8)
    swept = best.after(at, number(1, wide))
    assert swept.cell == spots[1]
    assert swept.heading == pytest.approx(heading + side)  # the sweep ends at its far side


def test_views_from_further_viewpoints_are_those_made_anew() -> None:
    some = shots().viewpoints[::2]
    further = np.unique(np.append(some, den().floor()[[5, 40]]))
    made = candidate_views(den(), SENSOR, MOTION, viewpoints=some).with_viewpoints(den(), further)
    anew = candidate_views(den(), SENSOR, MOTION, viewpoints=further)
    for name in ("viewpoints", "viewpoint", "heading", "extent", "seconds"):
        assert np.array_equal(getattr(made, name), getattr(anew, name)), name
    for view in range(len(anew.heading)):
        assert np.array_equal(made.chance[view], anew.chance[view])
    assert np.array_equal(made.ways.metres, anew.ways.metres)
