"""Looks, belief on cells and the next look, in small made-up homes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.space.building import free_space
from planner.space.grid import FreeSpace, Room
from planner.space.sight import visible
from planner.viewing.belief import belief_from, room_weights
from planner.viewing.covers import room_covers
from planner.viewing.looks import Looks, candidate_looks, picture
from planner.viewing.memory import Memory
from planner.viewing.sensor import Motion, Sensor
from planner.viewing.tour import Standing, Tourist

quick = settings(max_examples=30, deadline=None)


@cache
def home() -> FreeSpace:
    return free_space([Room(0, 5, 0, 4), Room(5, 8, 0, 4), Room(0, 8, 4, 5.4)])


@cache
def looks() -> Looks:
    return candidate_looks(home(), Sensor(far=3.0, recall=0.7))


weights = st.integers(0, 10**6).map(
    lambda seed: np.random.default_rng(seed).random(len(looks().cells)) ** 4
)


def test_what_looks_show_is_in_range_in_view_and_behind_no_wall() -> None:
    centres = home().centres(looks().cells)
    for number in range(0, len(looks().stand), 7):
        shown = looks().chance[number] > 0
        stand = home().centres([looks().stands[looks().stand[number]]])[0]
        metres = np.linalg.norm(centres[shown] - stand, axis=1)
        assert ((metres >= 0.8 - 1e-9) & (metres <= 3.0 + 1e-9)).all()
    shut = free_space([Room(0, 4, 0, 4), Room(4, 8, 0, 4)], doors=[])
    blocked = candidate_looks(shut, Sensor(), stands=np.array([shut.nearest((2, 2), 0)]))
    rooms = shut.room.reshape(-1)[blocked.cells]
    assert (blocked.chance[:, rooms == 1] == 0).all()
    assert (blocked.chance[:, rooms == 0] > 0).any()


def test_a_picture_on_the_way_is_a_look_from_there() -> None:
    stand, kind = int(looks().stands[0]), int(np.flatnonzero(looks().stand == 0)[0])
    told = picture(looks(), stand, float(looks().heading[kind]))
    assert np.array_equal(told, looks().chance[kind])


@settings(max_examples=8, deadline=None)
@given(st.sampled_from([1.5, 3.0, 4.6]), st.floats(0.5, 0.99))
def test_covers_cover_and_more_is_no_less(far: float, share: float) -> None:
    few = room_covers(home(), far, cover=share)
    many = room_covers(home(), far, cover=1.0)
    for room, stands in few.items():
        floor = home().floor(room)
        # looks from the lattice may not show every corner, but no cover shows more than they do
        assert _seen(stands, floor, far) >= min(share, _seen(many[room], floor, far)) - 1e-9
        assert _seen(many[room], floor, far) >= _seen(stands, floor, far) - 1e-9


def _seen(stands: np.ndarray, floor: np.ndarray, far: float) -> float:
    seen = [visible(home(), int(stand), far)[0] for stand in stands]
    return float(np.isin(floor, np.concatenate(seen)).mean())


def test_a_second_look_from_the_same_place_is_worth_less() -> None:
    weight = np.full(len(looks().cells), 1 / len(looks().cells))
    memory = Memory(looks())
    before = memory.gains(weight)
    look = int(np.argmax(before))
    assert before == pytest.approx(looks().chance @ weight, rel=1e-4)
    memory.note(look)
    after = memory.gains(weight)
    assert after[look] == pytest.approx(0.2 * before[look], rel=1e-3)  # 1 - rho
    elsewhere = looks().stand != looks().stand[look]
    assert after[elsewhere] == pytest.approx(before[elsewhere])
    assert memory.chance(look).sum() == pytest.approx(0.2 * looks().chance[look].sum(), rel=1e-3)


def test_the_first_look_goes_where_it_most_likely_is() -> None:
    cells = looks().cells
    for room in (0, 1):
        belief = belief_from(cells, room_weights(home(), cells, {room: 1.0}), 0.0, everywhere=0.0)
        start = home().nearest((6.5, 2.0) if room == 0 else (1.0, 2.0))
        look = Tourist(looks()).best(Standing(start), belief.weight)
        assert look is not None
        shown = home().room.reshape(-1)[cells[looks().chance[look] > 0]]
        assert (shown == room).any()


@pytest.mark.parametrize("wrong", [{"near": 5.0}, {"recall": 0.0}, {"rho": 1.5}])
def test_what_no_camera_can_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"must lie|needs"):
        Sensor(**wrong)
    with pytest.raises(ValueError, match="speed"):
        Motion(speed=0.0)
