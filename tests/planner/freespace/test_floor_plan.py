"""Free space, sight and shortest ways, on made-up buildings of any shape."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.model.areas import Area
from kg.model.errors import LayoutError
from planner.freespace.floor_plan import free_space
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import NO_ROOM, FreeSpace, visible_cells
from tests.planner.freespace.distances import metres_between

quick = settings(max_examples=30, deadline=None)


@st.composite
def spaces(draw: st.DrawFn) -> FreeSpace:
    """Floors of up to 10 x 10 cells with walls anywhere."""
    nx, ny = draw(st.integers(3, 10)), draw(st.integers(3, 10))
    seed, share = draw(st.integers(0, 10**6)), draw(st.floats(0.0, 0.5))
    wall = np.random.default_rng(seed).random((nx, ny)) < share
    wall[nx // 2, ny // 2] = False
    room = np.where(wall, NO_ROOM, 0).astype(np.int32)
    return FreeSpace(np.zeros(2), 0.2, room)


@quick
@given(spaces(), st.sampled_from([0.3, 0.9, 1.7]), st.data())
def test_who_is_seen_sees(space: FreeSpace, reach: float, data: st.DataObject) -> None:
    cell = int(data.draw(st.sampled_from(space.floor().tolist())))
    seen, offset = visible_cells(space, cell, reach)
    assert cell in seen
    assert np.isin(seen, space.floor()).all()
    assert np.allclose(space.centres(seen) - space.centres([cell]), offset)
    for other in seen.tolist():
        assert cell in visible_cells(space, other, reach)[0]


def test_walls_are_not_seen_through_and_doors_are() -> None:
    rooms = [Area(0, 4, 0, 4), Area(4, 8, 0, 4)]
    shut = free_space(rooms, doors=[])
    assert (shut.room.reshape(-1)[visible_cells(shut, shut.nearest((2, 2)), 6.0)[0]] == 0).all()
    ajar = free_space(rooms)
    seen = ajar.room.reshape(-1)[visible_cells(ajar, ajar.nearest((2, 2)), 6.0)[0]]
    assert (seen == 1).any()
    in_line = ajar.nearest((6, 2))
    assert in_line in visible_cells(ajar, ajar.nearest((2, 2)), 6.0)[0]
    assert ajar.nearest((6, 0.3)) not in visible_cells(ajar, ajar.nearest((2, 0.3)), 6.0)[0]


@quick
@given(spaces(), st.data())
def test_ways_are_no_shorter_than_straight_lines(space: FreeSpace, data: st.DataObject) -> None:
    cells = data.draw(st.lists(st.sampled_from(space.floor().tolist()), min_size=3, max_size=5))
    p = space.centres(cells)
    straight = np.linalg.norm(p[:, None] - p[None, :], axis=2)
    assert (metres_between(space, cells) >= straight - 1e-4).all()
    open_floor = FreeSpace(np.zeros(2), 0.2, np.zeros((36, 36), np.int32))
    x, y = data.draw(st.tuples(st.integers(0, 35), st.integers(0, 35)))
    metres, direct = distance_fields(open_floor, [0])[0], 0.2 * float(np.hypot(x, y))
    assert direct - 1e-4 <= metres[x, y] <= 1.028 * direct + 1e-4


@quick
@given(st.data())
def test_every_room_of_a_building_is_reached(data: st.DataObject) -> None:
    number = st.floats(-8, 8).map(lambda value: round(value, 1))
    size = st.floats(0.4, 6).map(lambda value: round(value, 1))
    corners = st.lists(st.tuples(number, number, size, size), min_size=1, max_size=6)
    rooms = [Area(x, x + dx, y, y + dy) for x, y, dx, dy in data.draw(corners)]
    space = free_space(rooms)
    start = int(space.floor()[0])
    assert space.reachable(start).reshape(-1)[space.floor()].all()
    assert np.isfinite(distance_fields(space, [start])[0].reshape(-1)[space.floor()]).all()


@pytest.mark.parametrize("east", [2e6, 1e308])
def test_rooms_that_no_grid_holds_are_refused(east: float) -> None:
    with pytest.raises(
        LayoutError, match=r"the places span .* correct their edges to within 2000 m"
    ):
        free_space([Area(-east, east, 0.0, 300.0), Area(0.0, 3.0, 0.0, 3.0)])


def test_a_layout_without_floor_is_refused() -> None:
    with pytest.raises(LayoutError, match="at least one room"):
        free_space([])
    with pytest.raises(LayoutError, match="no free floor"):
        FreeSpace(np.zeros(2), 0.2, np.full((3, 3), NO_ROOM, np.int32))
