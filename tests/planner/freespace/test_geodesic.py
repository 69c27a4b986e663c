"""Sweeps give exactly Dijkstra's lengths, and passages are taken."""

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kg.model.areas import Area
from kg.model.errors import LayoutError
from planner.freespace.floor_plan import free_space
from planner.freespace.geodesic import (
    FAR,
    UNIT,
    StepLengths,
    cells_before,
    distance_fields,
    path_lengths,
    shortest_path,
)
from planner.freespace.grid import NO_ROOM, FreeSpace, Passage
from tests.planner.freespace.distances import metres_between

Mask = NDArray[np.bool_]
CORNER_BY_CORNER = [(1, 0), (1, 1), (1, 2), (2, 1)]


@st.composite
def floors(draw: st.DrawFn) -> Mask:
    rows, columns = draw(st.integers(2, 8)), draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    passable = rng.random((rows, columns)) > draw(st.sampled_from([0.0, 0.2, 0.4]))
    passable[0, 0] = True
    return passable


def all_fields(lengths: StepLengths, sources: NDArray[np.intp]) -> NDArray[np.int32]:
    return np.vstack(list(path_lengths(lengths, sources)))


def dijkstra(passable: Mask, links: dict[tuple[int, int], int], source: int) -> NDArray[np.int64]:
    """Lengths to every cell, by steps written down anew: what they touch must be floor."""
    field = np.full(passable.size, FAR, np.int64)
    field[source] = 0
    queue = [(0, source)]
    while queue:
        so_far, cell = heapq.heappop(queue)
        if so_far > field[cell]:
            continue
        for there, length in [*steps(passable, cell), *jumps(links, cell)]:
            if so_far + length < field[there]:
                field[there] = so_far + length
                heapq.heappush(queue, (so_far + length, there))
    return field


def jumps(links: dict[tuple[int, int], int], cell: int) -> list[tuple[int, int]]:
    return [(b if cell == a else a, length) for (a, b), length in links.items() if cell in (a, b)]


def steps(passable: Mask, cell: int) -> list[tuple[int, int]]:
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
                if all(passable[c] for c in cells):
                    length = {1: UNIT, 2: 1415, 5: 2237}[ahead**2 + aside**2]
                    found.append((x * columns + y, length))
    x = here[0]
    sides = [y for y in (here[1] - 1, here[1] + 1) if 0 <= y < columns and passable[x, y]]
    return found + [(x * columns + y, UNIT) for y in sides]


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
def test_all_sources_at_once_are_as_dijkstra_one_by_one(passable: Mask, stairs: bool) -> None:
    sources = np.flatnonzero(passable)
    links = {(int(sources[0]), int(sources[-1])): 700} if stairs and len(sources) > 1 else {}
    lengths = StepLengths.over(passable, tuple((*ends, n) for ends, n in links.items()))
    for source, field in zip(sources.tolist(), all_fields(lengths, sources), strict=True):
        np.testing.assert_array_equal(field, dijkstra(passable, links, source))


@settings(max_examples=40, deadline=None)
@given(floors())
def test_lengths_are_exactly_symmetric_and_triangular(passable: Mask) -> None:
    cells = np.flatnonzero(passable)
    length = all_fields(StepLengths.over(passable), cells)[:, cells].astype(np.int64)
    np.testing.assert_array_equal(length, length.T)
    assert np.all(length[:, None, :] <= length[:, :, None] + length[None, :, :])


@settings(max_examples=20, deadline=None)
@given(floors())
def test_lengths_over_unseen_floor_are_symmetric_and_triangular_too(passable: Mask) -> None:
    cells, unseen = np.flatnonzero(passable), np.indices(passable.shape).sum(axis=0) % 3 == 0
    length = all_fields(StepLengths.over(passable, (), unseen), cells)[:, cells].astype(np.int64)
    np.testing.assert_array_equal(length, length.T)
    assert np.all(length[:, None, :] <= length[:, :, None] + length[None, :, :])


@pytest.mark.parametrize(("wide", "taken"), [(5, True), (2, False)])
def test_ways_lead_around_floor_that_nobody_saw_unless_it_saves_two_thirds(wide, taken):
    room, unseen = np.full((9, 2 * wide + 1), NO_ROOM, np.int32), np.zeros((9, 2 * wide + 1), bool)
    room[:, 0] = room[:, -1] = room[0] = room[4] = 0
    unseen[4, 1:-1] = True
    space = FreeSpace(np.zeros(2), 1.0, room, unseen=unseen)
    a, b = 4 * room.shape[1], 5 * room.shape[1] - 1
    field = distance_fields(space, [b])[0]
    through = 1.0 + 3.0 * (2 * wide - 1) + 1.0 + 1.0 - 1.0
    around = 2.0 * wide + 8.0
    assert field.flat[a] == pytest.approx(min(through, around), abs=1.3)
    assert (shortest_path(space, field, a) // room.shape[1]).min() == (0 if taken else 4)


def two_rooms(*passages: Passage) -> FreeSpace:
    """Floor of 5 x 9 cells of a metre, a wall along x = 2 with a gap at y = 4."""
    room = np.zeros((5, 9), np.int32)
    room[2], room[2, 4] = NO_ROOM, 0
    return FreeSpace(np.zeros(2), 1.0, room, passages)


def test_a_path_takes_the_gap_or_a_passage_whichever_is_shorter() -> None:
    a, b = 1 * 9 + 8, 3 * 9 + 8
    space = two_rooms()
    field = distance_fields(space, [b])[0]
    assert 2 * 9 + 4 in shortest_path(space, field, a)
    around = two_rooms(Passage(8, 4 * 9 + 8, 1.0))
    field = distance_fields(around, [b])[0]
    assert field.flat[a] == pytest.approx(3.0)
    assert shortest_path(around, field, a).tolist() == [a, 8, 4 * 9 + 8, b]


@settings(max_examples=40, deadline=None)
@given(floors(), st.data())
def test_a_path_leads_downhill_and_is_about_as_long_as_its_field_says(passable, data):
    space = FreeSpace(np.zeros(2), 1.0, np.where(passable, 0, NO_ROOM).astype(np.int32))
    start, goal = (data.draw(st.sampled_from(space.floor().tolist())) for _ in range(2))
    field = distance_fields(space, [goal])[0]
    if not np.isfinite(field.flat[start]):
        with pytest.raises(LayoutError, match="no way leads there"):
            shortest_path(space, field, start)
        return
    cells = shortest_path(space, field, start)
    xy = space.centres(cells)
    driven = float(np.linalg.norm(np.diff(xy, axis=0), axis=1).sum())
    assert (cells[0], cells[-1]) == (start, goal)
    assert np.isin(cells, space.floor()).all()
    assert (np.diff(field.reshape(-1)[cells]) < 0).all()
    # three king's moves for a knight's, where both corners beside it are cut off
    assert driven <= float(field.flat[start]) * 3 / np.sqrt(5) + 0.01


def test_a_passage_to_what_is_no_floor_leads_nowhere() -> None:
    space = two_rooms(Passage(0, 2 * 9, 1.0)).without([2 * 9 + 4])
    assert np.isinf(metres_between(space, [0, 44])[0, 1])


def test_the_last_cells_of_shortest_ways_to_many_ends() -> None:
    space = free_space([Area(0, 5, 0, 4), Area(5, 8, 0, 4), Area(0, 8, 4, 5.4)])
    start, ends = int(space.floor()[7]), space.floor()[::9]
    (field,) = distance_fields(space, [start])
    before = cells_before(space, field, ends, 1)
    for end, cell in zip(ends.tolist(), before.tolist(), strict=True):
        assert cell == shortest_path(space, field, end)[:2][-1]
