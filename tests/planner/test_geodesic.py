"""Sweeps give exactly Dijkstra's lengths, tolls are paid, and passages are taken."""

from __future__ import annotations

import heapq
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kg.errors import LayoutError
from planner.space.geodesic import distance_fields, metres_between, way
from planner.space.grid import NO_ROOM, FreeSpace, Passage
from planner.space.sweep import FAR, UNIT, StepCosts, swept

Floor = tuple[NDArray[np.bool_], NDArray[np.int32]]
CORNER_BY_CORNER = [(1, 0), (1, 1), (1, 2), (2, 1)]


@st.composite
def floors(draw: st.DrawFn) -> Floor:
    rows, columns = draw(st.integers(2, 8)), draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    passable = rng.random((rows, columns)) > draw(st.sampled_from([0.0, 0.2, 0.4]))
    toll = rng.integers(0, 4, (rows, columns)) * 500 * (rng.random((rows, columns)) < 0.2)
    passable[0, 0] = True
    return passable, toll.astype(np.int32)


def all_fields(costs: StepCosts, sources: NDArray[np.intp]) -> NDArray[np.int32]:
    return np.vstack(list(swept(costs, sources)))


def dijkstra(floor: Floor, links: dict[tuple[int, int], int], source: int) -> NDArray[np.int64]:
    """Lengths to every cell, by steps written down anew: what they touch must be floor."""
    passable, toll = floor
    field = np.full(passable.size, FAR, np.int64)
    field[source] = 0
    queue = [(0, source)]
    while queue:
        so_far, cell = heapq.heappop(queue)
        if so_far > field[cell]:
            continue
        for there, cost in [*steps(passable, toll, cell), *jumps(links, cell)]:
            if so_far + cost < field[there]:
                field[there] = so_far + cost
                heapq.heappush(queue, (so_far + cost, there))
    return field


def jumps(links: dict[tuple[int, int], int], cell: int) -> list[tuple[int, int]]:
    return [(b if cell == a else a, cost) for (a, b), cost in links.items() if cell in (a, b)]


def steps(passable: NDArray[np.bool_], toll: NDArray[np.int32], cell: int) -> list[tuple[int, int]]:
    rows, columns = passable.shape
    here = divmod(cell, columns)
    found = []
    for ahead, aside in CORNER_BY_CORNER:
        for sign_x in (1, -1):
            for sign_y in (1, -1):
                x, y = here[0] + sign_x * ahead, here[1] + sign_y * aside
                between = [
                    (here[0] + sign_x * i, here[1] + sign_y * j) for i, j in passed(ahead, aside)
                ]
                cells = [*between, (x, y)]
                if any(not (0 <= i < rows and 0 <= j < columns) for i, j in cells):
                    continue
                if not all(passable[c] for c in cells):
                    continue
                length = {1: UNIT, 2: 1415, 5: 2237}[ahead**2 + aside**2]
                ends = int(toll[here]) + int(toll[x, y])
                paid = sum(int(toll[c]) // len(between) for c in between)
                found.append((x * columns + y, length + ends // 2 + paid))
    return found + ([] if not passable[here] else straight_aside(passable, toll, here))


def straight_aside(
    passable: NDArray[np.bool_], toll: NDArray[np.int32], here: tuple[int, int]
) -> list[tuple[int, int]]:
    x, columns = here[0], passable.shape[1]
    sides = [y for y in (here[1] - 1, here[1] + 1) if 0 <= y < columns and passable[x, y]]
    return [(x * columns + y, UNIT + (int(toll[here]) + int(toll[x, y])) // 2) for y in sides]


def passed(ahead: int, aside: int) -> list[tuple[int, int]]:
    """The cells a step touches between its ends."""
    return {
        (1, 0): [],
        (1, 1): [(0, 1), (1, 0)],
        (1, 2): [(0, 1), (1, 1)],
        (2, 1): [(1, 0), (1, 1)],
    }[ahead, aside]


@settings(max_examples=30, deadline=None)
@given(floors(), st.booleans())
def test_all_sources_at_once_are_as_dijkstra_one_by_one(floor: Floor, stairs: bool) -> None:
    passable, toll = floor
    sources = np.flatnonzero(passable)
    links = {(int(sources[0]), int(sources[-1])): 700} if stairs and len(sources) > 1 else {}
    costs = StepCosts.over(passable, toll, tuple((*ends, cost) for ends, cost in links.items()))
    for source, field in zip(sources.tolist(), all_fields(costs, sources), strict=True):
        np.testing.assert_array_equal(field, dijkstra(floor, links, source))
        told = costs.neighbours(source)
        expected = [*steps(passable, toll, source), *jumps(links, source)]
        assert dict(sorted(told, reverse=True)) == dict(sorted(expected, reverse=True))


@settings(max_examples=40, deadline=None)
@given(floors())
def test_lengths_are_exactly_symmetric_and_triangular(floor: Floor) -> None:
    cells = np.flatnonzero(floor[0])
    length = all_fields(StepCosts.over(*floor), cells)[:, cells].astype(np.int64)
    np.testing.assert_array_equal(length, length.T)
    assert np.all(length[:, None, :] <= length[:, :, None] + length[None, :, :])


def test_many_sources_are_answered_in_their_order() -> None:
    space = FreeSpace(np.zeros(2), 0.5, np.zeros((20, 20), np.int32))
    sources = np.arange(400)[::-1]
    fields = distance_fields(space, sources).reshape(400, 400)
    np.testing.assert_array_equal(fields[np.arange(400), sources], 0.0)
    assert (np.sort(fields, axis=1)[:, 1] == 0.5).all()
    assert distance_fields(space, []).shape == (0, 20, 20)


def test_no_way_slips_between_two_cells_that_touch_at_a_corner() -> None:
    room = np.where(np.eye(9, dtype=np.bool_), NO_ROOM, 0).astype(np.int32)
    field = distance_fields(FreeSpace(np.zeros(2), 0.2, room), [8])[0]
    assert np.isinf(field[np.tril_indices(9)]).all()


def two_rooms(*passages: Passage) -> FreeSpace:
    """Floor of 5 x 9 cells of a metre, a wall along x = 2 with a gap at y = 4."""
    room = np.zeros((5, 9), np.int32)
    room[2], room[2, 4] = NO_ROOM, 0
    return FreeSpace(np.zeros(2), 1.0, room, passages)


def test_a_toll_is_paid_once_in_passing_and_gone_around_where_that_is_shorter() -> None:
    space = two_rooms()
    toll = np.zeros(space.shape)
    toll[2, 4] = 7.5
    a, b = 1 * 9 + 4, 3 * 9 + 4
    assert distance_fields(space, [a])[0].flat[b] == pytest.approx(2.0)
    assert distance_fields(space, [a], toll)[0].flat[b] == pytest.approx(9.5)
    around = two_rooms(Passage(0, 4 * 9, 1.0))
    field = distance_fields(around, [b], toll)[0]
    assert field.flat[a] < 9.5
    cells = way(around, field, a, toll).tolist()
    assert {0, 4 * 9} <= set(cells)
    assert 2 * 9 + 4 not in cells


@settings(max_examples=40, deadline=None)
@given(floors(), st.data())
def test_with_tolls_a_way_costs_what_its_field_says(floor: Floor, data: st.DataObject) -> None:
    passable, toll = floor
    space = FreeSpace(np.zeros(2), 1.0, np.where(passable, 0, NO_ROOM).astype(np.int32))
    start, goal = (data.draw(st.sampled_from(space.floor().tolist())) for _ in range(2))
    metres = toll / UNIT
    field = distance_fields(space, [goal], metres)[0]
    if not np.isfinite(field.flat[start]):
        return
    cells = way(space, field, start, metres).tolist()
    costs = StepCosts.over(passable, toll)
    paid = sum(
        min(cost for there, cost in costs.neighbours(a) if there == b) for a, b in pairwise(cells)
    )
    assert cells[-1] == goal
    assert paid / UNIT == pytest.approx(float(field.flat[start]), abs=1e-3)


def test_a_passage_to_what_is_no_floor_leads_nowhere() -> None:
    space = two_rooms(Passage(0, 2 * 9, 1.0)).without([2 * 9 + 4])
    assert np.isinf(metres_between(space, [0, 44])[0, 1])


@pytest.mark.parametrize("toll", [-np.ones((5, 9)), np.ones((9, 5)), np.full((5, 9), np.nan)])
def test_tolls_that_are_no_metres_for_each_cell_are_refused(toll: NDArray[np.float64]) -> None:
    with pytest.raises(LayoutError, match="tolls must be metres"):
        distance_fields(two_rooms(), [0], toll)
