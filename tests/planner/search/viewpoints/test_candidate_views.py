"""Candidate views: what sweeps from the floor show, and what they cost."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace, Room
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    belief_cells,
    candidate_views,
    floor_in_view,
    square,
)
from planner.search.viewpoints.next_best_view import NextBestView, RobotState
from planner.search.viewpoints.sensor import Motion, Sensor

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
    assert np.array_equal(belief_cells(space, 10**6), space.inside())
    few = belief_cells(space, 100)
    assert 50 <= len(few) <= 101
    assert set(space.room.reshape(-1)[few].tolist()) == {0, 1}
    assert np.isin(few, space.inside()).all()


def test_squares_have_sides_of_a_metre() -> None:
    middles = home().origin + np.array([[0.1, 0.1], [0.9, 0.9], [1.1, 0.9], [0.9, 1.1]])
    cells = [
        int(np.argmin(((home().centres(np.arange(home().room.size)) - p) ** 2).sum(axis=1)))
        for p in middles
    ]
    assert len({square(home(), cell) for cell in cells}) == 3
    assert square(home(), cells[0]) == square(home(), cells[1])


def test_a_view_costs_the_way_the_turn_and_the_sweep() -> None:
    heading = math.pi / 2
    spots = [home().nearest((x, 2.1), 0) for x in (1.1, 3.1)]
    made = candidate_views(
        home(), SENSOR, MOTION, viewpoints=np.array(spots), kinds=[(heading, 1.0), (heading, 1.8)]
    )
    best = NextBestView(made)
    here, there = made.viewpoint == 0, made.viewpoint == 1
    at = RobotState(spots[0], heading=heading)
    costs = best.costs(at, np.arange(4))
    assert costs[here] == pytest.approx([2.0, 0.4 / 0.8 + 2.0 + 0.8 / 0.8])
    # the robot comes along x, and turns from there to the nearer end of the sweep
    way = 2.0 / 0.5
    assert costs[there] == pytest.approx(
        [way + heading / 0.8 + 2.0, way + (heading - 0.4) / 0.8 + 2.0 + 0.8 / 0.8]
    )
    swept = best.after(at, int(np.flatnonzero(there)[1]))
    assert (swept.cell, swept.viewpoint) == (spots[1], 1)
    assert swept.heading == pytest.approx(heading + 0.4)  # the sweep ends at its far side


def test_without_a_view_ahead_the_next_one_gains_most_for_its_time() -> None:
    rng = np.random.default_rng(7)
    myopic = NextBestView(views(), ahead=0)
    for spot in ((1.0, 1.0), (7.5, 3.0)):
        at = RobotState(home().nearest(spot))
        weight = rng.random(len(views().cells)) ** 8
        rate = (views().chance @ weight) / myopic.costs(at, np.arange(len(views().heading)))
        view = myopic.best(at, weight / weight.sum())
        assert view is not None
        assert rate[view] == pytest.approx(rate.max(), rel=1e-4)
    assert myopic.best(at, np.zeros(len(views().cells))) is None


def test_views_from_further_viewpoints_are_those_made_anew() -> None:
    some = views().viewpoints[::2]
    further = np.unique(np.append(some, home().floor()[[5, 40]]))
    made = candidate_views(home(), SENSOR, MOTION, viewpoints=some).with_viewpoints(home(), further)
    anew = candidate_views(home(), SENSOR, MOTION, viewpoints=further)
    for name in ("viewpoints", "viewpoint", "heading", "extent", "seconds", "chance", "fields"):
        assert np.array_equal(getattr(made, name), getattr(anew, name)), name
