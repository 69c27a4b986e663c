"""What a hunt makes of looks in vain: Bayes' rule, fresh positions, and when it gives up."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.finding.ground import Ground
from planner.finding.hunt import Hunt
from planner.finding.prospects import Prospects
from planner.finding.settings import MOST_ROUNDS, Belief
from planner.finding.targets import Target
from planner.space.building import free_space
from planner.space.grid import FreeSpace, Room
from planner.space.sight import visible
from planner.viewing.belief import room_weights, site_weights
from planner.viewing.covers import room_covers, standing_cells
from planner.viewing.looks import Looks, candidate_looks
from planner.viewing.memory import Memory
from planner.viewing.sensor import Sensor
from planner.viewing.tour import Standing

quick = settings(max_examples=30, deadline=None)


@cache
def home() -> FreeSpace:
    return free_space([Room(0, 5, 0, 4), Room(5, 8, 0, 4), Room(0, 8, 4, 5.4)])


@cache
def looks() -> Looks:
    return candidate_looks(home(), Sensor(far=3.0))


def one_thing(weight: np.ndarray) -> Prospects:
    return Prospects(looks().cells, weight[None, :], np.zeros(1, np.intp), ())


def hunt(belief: Belief, weight: np.ndarray | None = None, among: Looks | None = None) -> Hunt:
    among = among or looks()
    space, cells = among.space, among.cells
    names = ("",) * (int(space.room.max()) + 1)
    if weight is None:
        weight = 0.9 * room_weights(space, cells, {0: 0.8, 1: 0.15, 2: 0.05})
    known = Prospects(cells, weight[None, :], np.zeros(1, np.intp), ())
    it = Target("it", "it", None, {}, {})
    return Hunt((it,), Ground(space, names, names), among, (), known, belief)


def searched_in_vain(one: Hunt) -> list[int]:
    """Cells looked from until it is given up."""
    at, cells = Standing(int(one.space.floor()[0])), []
    while (look := one.next(at)) is not None:
        at = one.tourist.after(at, look)
        cells.append(at.cell)
        one.missed(look)
        assert len(cells) < 2000
    return cells


@quick
@given(st.integers(0, 10**6), st.floats(0.1, 1.0), st.data())
def test_belief_keeps_its_mass_through_looks_in_vain(
    seed: int, present: float, data: st.DataObject
) -> None:
    weight = np.random.default_rng(seed).random(len(looks().cells)) ** 4
    known, unseen = one_thing(weight / weight.sum() * present), np.ones(len(weight))
    for look in data.draw(st.lists(st.integers(0, len(looks().stand) - 1), max_size=6)):
        before = known.belief(unseen, [0], 1)
        unseen = unseen * (1 - looks().chance[look])
        after, shown = known.belief(unseen, [0], 1), looks().chance[look] > 0
        assert after.weight.sum() + after.absent == pytest.approx(1)
        assert after.absent >= before.absent - 1e-12
        assert (after.weight[~shown] >= before.weight[~shown] - 1e-12).all()
        assert after.weight[shown].sum() <= before.weight[shown].sum() + 1e-12


def test_a_remembered_site_and_its_room_are_one_belief() -> None:
    cells = looks().cells
    site = site_weights(home(), cells, (1.0, 1.0), 0.3)
    weight = site + room_weights(home(), cells, {0: 1.0})
    known, unseen = one_thing(0.9 * weight / weight.sum()), np.ones(len(cells))
    before = known.belief(unseen, [0], 1)
    near = site > site.max() / 10
    after = known.belief(np.where(near, 0.1, 1.0), [0], 1)
    assert after.of_room(home(), 0) < before.of_room(home(), 0)
    assert after.weight[~near].sum() > before.weight[~near].sum()


def test_a_search_in_vain_goes_on_from_fresh_positions_until_little_was_overlooked() -> None:
    hasty, patient = hunt(Belief(rest=0.1)), hunt(Belief())
    begun, total = searched_in_vain(hasty), searched_in_vain(patient)
    assert total[: len(begun)] == begun
    assert len(begun) < len(total)
    assert set(looks().stands) < set(patient.looks.stands)
    assert not set(total) <= set(looks().stands.tolist())
    assert hasty.overlooked <= 0.1
    assert patient.overlooked <= Belief().rest < hasty.overlooked


def test_a_belief_that_misleads_does_not_end_a_search() -> None:
    weight = 0.89 * room_weights(home(), looks().cells, {0: 1.0}) + 0.01 / len(looks().cells)
    misled = hunt(Belief(), weight)
    searched_in_vain(misled)
    elsewhere = home().room.reshape(-1)[looks().cells] != 0
    seen = misled.tourist.seeable & elsewhere
    assert misled.unseen[seen].mean() < 0.01
    assert misled.overlooked <= Belief().rest


def test_floor_that_is_cut_off_keeps_nobody_looking_at_the_rest() -> None:
    shut = hunt(Belief())
    edge = np.abs(home().centres(home().inside())[:, 1] - 4.0) < 0.5  # before and behind the wall
    shut.blocked(home().inside()[edge])
    taken = searched_in_vain(shut)
    at = Standing(int(home().floor()[0]))
    seen = shut.tourist.seeable_from(at)
    assert 0 < seen.mean() < 1
    assert np.isfinite(shut.looks.metres_from(at.cell)[np.isin(shut.looks.stands, taken)]).all()
    assert shut.unseen[seen].mean() <= Belief().rest < shut.overlooked


def test_what_no_position_sees_does_not_keep_a_search_going() -> None:
    space = free_space([Room(0, 4, 0, 3), Room(20, 20.4, 20, 20.4)])
    away = candidate_looks(space, Sensor(far=3.0), stands=standing_cells(space, 3.0, covers=1))
    one = hunt(Belief(), np.full(len(away.cells), 0.9 / len(away.cells)), away)
    searched_in_vain(one)
    assert one.overlooked <= Belief().rest or one.rounds == MOST_ROUNDS


def test_what_was_looked_at_is_remembered_among_other_positions() -> None:
    memory = Memory(looks())
    for look in (3, 3, 40):
        memory.note(look)
    fewer = looks().with_stands(home(), looks().stands[1:])
    weight = np.ones(len(looks().cells))
    kept = looks().stand >= 1
    before = memory.gains(weight)[kept]
    assert memory.moved_to(fewer).gains(weight) == pytest.approx(before)
    assert before[40 - int((~kept).sum())] < Memory(fewer).gains(weight)[40 - int((~kept).sum())]


def test_a_closet_that_is_seen_from_no_lattice_position_is_looked_into() -> None:
    space = free_space([Room(0, 5, 0, 4), Room(5, 6.2, 1.4, 2.2)])
    reach, near = 4.6, 0.8
    covers = room_covers(space, reach, near=near, cover=0.995, covers=2)
    assert _seen(space, sorted({int(c) for cells in covers.values() for c in cells})) < 0.2
    assert _seen(space, standing_cells(space, reach, near=near).tolist()) > 0.8


def _seen(space: FreeSpace, stands: list[int]) -> float:
    """Share of the closet that is seen from `stands`."""
    shown: set[int] = set()
    for stand in stands:
        cells, offset = visible(space, stand, 4.6)
        shown.update(cells[np.hypot(*offset.T) >= 0.8].tolist())
    closet = space.floor(1).tolist()
    return len(shown.intersection(closet)) / len(closet)
