"""Candidate views: what sweeps from the floor show, and what they cost."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace, Room
from planner.search.viewpoints import next_best_view
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    Motion,
    Sensor,
    belief_cells,
    candidate_views,
    floor_in_view,
    square,
)
from planner.search.viewpoints.next_best_view import NextBestView, RobotState

SENSOR = Sensor(near=0.5, far=2.5, field_of_view=1.0)
MOTION = Motion(speed=0.5, turn_rate=0.8, picture=2.0)


@cache
def home() -> FreeSpace:
    return free_space([Room(0, 6, 0, 4), Room(6, 9, 0, 4)])


@cache
def views() -> CandidateViews:
    return candidate_views(home(), SENSOR, MOTION)


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_a_sweep_shows_the_floor_within_its_range_and_angle(heading: float) -> None:
    space, at = home(), home().nearest((3.0, 2.0), 0)
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
    for number in range(0, len(views().viewpoint), 5):
        at = int(views().viewpoints[views().viewpoint[number]])
        heading, extent = float(views().heading[number]), float(views().extent[number])
        shown = floor_in_view(home(), SENSOR, at, heading, extent)
        found = home().centres(views().cells[views().chance[number] > 0])
        assert sorted(map(tuple, found.round(6).tolist())) == sorted(
            map(tuple, shown.p_map.round(6).tolist())
        )


def test_a_belief_of_few_cells_has_some_in_every_room() -> None:
    space = free_space([Room(0, 20, 0, 20), Room(20, 20.7, 0, 0.7)])
    few = belief_cells(space)
    assert len(space.inside()) / 5 < len(few) < len(space.inside()) / 3
    assert set(space.room.reshape(-1)[few].tolist()) == {0, 1}
    assert np.isin(few, space.inside()).all()
    assert np.array_equal(belief_cells(home()), home().inside())


def test_squares_have_sides_of_a_metre() -> None:
    middles = home().origin + np.array([[0.1, 0.1], [0.9, 0.9], [1.1, 0.9], [0.9, 1.1]])
    cells = [
        int(np.argmin(((home().centres(np.arange(home().room.size)) - p) ** 2).sum(axis=1)))
        for p in middles
    ]
    assert len({square(home(), cell) for cell in cells}) == 3
    assert square(home(), cells[0]) == square(home(), cells[1])


def test_a_view_costs_the_way_the_turn_and_the_sweep() -> None:
    heading, wide = math.pi / 2, 2 * math.pi / 3
    spots = [home().nearest((x, 2.1), 0) for x in (1.1, 3.1)]
    made = candidate_views(home(), SENSOR, MOTION, viewpoints=np.array(spots))
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
    assert (swept.cell, swept.viewpoint) == (spots[1], 1)
    assert swept.heading == pytest.approx(heading + side)  # the sweep ends at its far side


def test_without_a_view_ahead_the_next_one_gains_most_for_its_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(next_best_view, "_AHEAD", 0)
    rng = np.random.default_rng(7)
    myopic = NextBestView(views())
    for spot in ((1.0, 1.0), (7.5, 3.0)):
        at = RobotState(home().nearest(spot))
        weight = rng.random(len(views().cells)) ** 8
        rate = (views().chance @ weight) / myopic.costs(at, np.arange(len(views().heading)))
        view = myopic.best(at, weight / weight.sum())
        assert view is not None
        assert rate[view] == pytest.approx(rate.max(), rel=1e-4)
        for room in myopic._rooms:
            first = int(room.rows[np.argmax(rate[room.rows])])
            revisits = next_best_view.RevisitModel(views())
            ahead = myopic._lookahead_rate(at, weight, room, first, revisits)
            assert ahead == pytest.approx(rate[first], rel=1e-4)
    assert myopic.best(at, np.zeros(len(views().cells))) is None


def test_views_from_further_viewpoints_are_those_made_anew() -> None:
    some = views().viewpoints[::2]
    further = np.unique(np.append(some, home().floor()[[5, 40]]))
    made = candidate_views(home(), SENSOR, MOTION, viewpoints=some).with_viewpoints(home(), further)
    anew = candidate_views(home(), SENSOR, MOTION, viewpoints=further)
    for name in ("viewpoints", "viewpoint", "heading", "extent", "seconds", "chance", "fields"):
        assert np.array_equal(getattr(made, name), getattr(anew, name)), name
