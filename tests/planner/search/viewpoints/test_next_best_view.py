"""Looks, belief on cells and the next look, in small made-up homes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.search.room_beliefs import belief_from, room_weights
from planner.freespace.floor_plan import free_space
from planner.freespace.grid import FreeSpace, Room, visible_cells
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    Motion,
    Sensor,
    angle_between,
    candidate_views,
    room_viewpoints,
    square,
    sweep_chance,
    sweep_over,
)
from planner.search.viewpoints.next_best_view import NextBestView, RevisitModel, RobotState

quick = settings(max_examples=30, deadline=None)
angles = st.floats(-10.0, 10.0)


@cache
def home() -> FreeSpace:
    return free_space([Room(0, 5, 0, 4), Room(5, 8, 0, 4), Room(0, 8, 4, 5.4)])


@cache
def views() -> CandidateViews:
    return candidate_views(home(), Sensor(far=3.0, recall=0.7))


weights = st.integers(0, 10**6).map(
    lambda seed: np.random.default_rng(seed).random(len(views().cells)) ** 4
)


def test_what_looks_show_is_in_range_in_view_and_behind_no_wall() -> None:
    centres = home().centres(views().cells)
    for number in range(0, len(views().viewpoint), 7):
        shown = views().chance[number] > 0
        viewpoint = home().centres([views().viewpoints[views().viewpoint[number]]])[0]
        metres = np.linalg.norm(centres[shown] - viewpoint, axis=1)
        assert ((metres >= 0.8 - 1e-9) & (metres <= 3.0 + 1e-9)).all()
    shut = free_space([Room(0, 4, 0, 4), Room(4, 8, 0, 4)], doors=[])
    blocked = candidate_views(shut, Sensor(), viewpoints=np.array([shut.nearest((2, 2), 0)]))
    rooms = shut.room.reshape(-1)[blocked.cells]
    assert (blocked.chance[:, rooms == 1] == 0).all()
    assert (blocked.chance[:, rooms == 0] > 0).any()


def test_a_picture_on_the_way_is_a_look_from_there() -> None:
    viewpoint, kind = int(views().viewpoints[0]), int(np.flatnonzero(views().viewpoint == 0)[0])
    heading, extent = float(views().heading[kind]), float(views().extent[kind])
    told = sweep_chance(views(), viewpoint, heading, extent)
    assert np.array_equal(told, views().chance[kind])


@settings(max_examples=8, deadline=None)
@given(st.sampled_from([1.5, 3.0, 4.6]), st.floats(0.5, 0.99))
def test_covers_cover_and_more_is_no_less(far: float, share: float) -> None:
    few = room_viewpoints(home(), far, cover=share)
    many = room_viewpoints(home(), far, cover=1.0)
    for room, viewpoints in few.items():
        floor = home().floor(room)
        # looks from the lattice may not show every corner, but no cover shows more than they do
        assert _seen(viewpoints, floor, far) >= min(share, _seen(many[room], floor, far)) - 1e-9
        assert _seen(many[room], floor, far) >= _seen(viewpoints, floor, far) - 1e-9


def _seen(viewpoints: np.ndarray, floor: np.ndarray, far: float) -> float:
    seen = [visible_cells(home(), int(viewpoint), far)[0] for viewpoint in viewpoints]
    return float(np.isin(floor, np.concatenate(seen)).mean())


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
    rate = none.gains(weight) / one.costs(at, np.arange(len(views().viewpoint)))
    starts = {int(room.rows[np.argmax(rate[room.rows])]): room for room in one._rooms}
    walks = {
        view: one._lookahead_rate(at, weight, room, view, none) for view, room in starts.items()
    }
    best = int(np.argmax(rate))
    assert one.best(at, weight) == max(walks, key=lambda v: (walks[v], v == best))


def test_the_first_look_goes_where_it_most_likely_is() -> None:
    cells = views().cells
    for room in (0, 1):
        belief = belief_from(cells, room_weights(home(), cells, {room: 1.0}), 0.0, everywhere=0.0)
        start = home().nearest((6.5, 2.0) if room == 0 else (1.0, 2.0))
        view = NextBestView(views()).best(RobotState(start), belief.weight)
        assert view is not None
        shown = home().room.reshape(-1)[cells[views().chance[view] > 0]]
        assert (shown == room).any()


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
