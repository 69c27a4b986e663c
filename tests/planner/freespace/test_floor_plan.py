"""Free space, sight and shortest ways, on made-up buildings of any shape."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.model.errors import LayoutError
from lab.thesis.table_4_5 import reference_world
from planner.freespace.floor_plan import free_space
from planner.freespace.geodesic import distance_fields, shortest_path
from planner.freespace.grid import NO_ROOM, FreeSpace, Room, visible_cells
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
    rooms = [Room(0, 4, 0, 4), Room(4, 8, 0, 4)]
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
def test_ways_are_a_metric_no_shorter_than_straight_lines(
    space: FreeSpace, data: st.DataObject
) -> None:
    floor = space.floor().tolist()
    cells = data.draw(st.lists(st.sampled_from(floor), min_size=3, max_size=5))
    metres = metres_between(space, cells)
    p = space.centres(cells)
    straight = np.linalg.norm(p[:, None] - p[None, :], axis=2)
    assert (metres >= straight - 1e-4).all()
    fields = distance_fields(space, cells).reshape(len(cells), -1)[:, cells]
    both = np.isfinite(fields)
    assert (both == both.T).all()
    assert np.allclose(fields[both], fields.T[both], atol=1e-4)
    detour = metres[:, :, None] + metres[None, :, :]
    assert (metres[:, None, :] <= detour + 1e-4).all()


@quick
@given(st.integers(0, 35), st.integers(0, 35))
def test_on_open_floor_ways_are_at_most_three_per_cent_too_long(x: int, y: int) -> None:
    space = FreeSpace(np.zeros(2), 0.2, np.zeros((36, 36), np.int32))
    metres = distance_fields(space, [0])[0]
    straight = 0.2 * float(np.hypot(x, y))
    assert straight - 1e-4 <= metres[x, y] <= 1.028 * straight + 1e-4


@quick
@given(spaces(), st.data())
def test_a_way_leads_downhill_over_floor(space: FreeSpace, data: st.DataObject) -> None:
    floor = space.floor().tolist()
    goal, start = (int(data.draw(st.sampled_from(floor))) for _ in range(2))
    field = distance_fields(space, [goal])[0]
    if not np.isfinite(field.reshape(-1)[start]):
        with pytest.raises(LayoutError, match="no way leads"):
            shortest_path(space, field, start)
        return
    cells = shortest_path(space, field, start)
    assert (cells[0], cells[-1]) == (start, goal)
    assert np.isin(cells, space.floor()).all()
    assert (np.diff(field.reshape(-1)[cells]) < 0).all()


@quick
@given(st.data())
def test_every_room_of_a_building_is_reached(data: st.DataObject) -> None:
    number = st.floats(-8, 8).map(lambda value: round(value, 1))
    size = st.floats(0.4, 6).map(lambda value: round(value, 1))
    rooms = [
        Room(x, x + dx, y, y + dy, height)
        for x, y, dx, dy, height in data.draw(
            st.lists(
                st.tuples(number, number, size, size, st.sampled_from([0.0, 2.8])),
                min_size=1,
                max_size=6,
            )
        )
    ]
    space = free_space(rooms)
    start = int(space.floor()[0])
    assert space.reachable(start).reshape(-1)[space.floor()].all()
    assert np.isfinite(distance_fields(space, [start])[0].reshape(-1)[space.floor()]).all()


def test_stairs_are_walked_but_not_seen_through() -> None:
    space = free_space([Room(0, 4, 0, 4), Room(0, 4, 0, 4, height=2.8)])
    below, above = space.nearest((2, 2), 0), space.nearest((2, 2), 1)
    assert above != below
    assert metres_between(space, [below, above])[0, 1] >= 2 * 2.8
    assert (space.room.reshape(-1)[visible_cells(space, below, 12.0)[0]] == 0).all()


def test_half_storeys_one_above_the_other_do_not_take_each_others_floor() -> None:
    halves = [Room(0, 4, 0, 4), Room(5, 9, 0, 4, height=0.9), Room(0, 4, 0, 4, height=1.8)]
    space = free_space(halves)
    assert min(len(space.floor(k)) for k in range(3)) > 0.8 * 16 / space.cell**2
    assert np.isfinite(metres_between(space, [space.floor(k)[0] for k in range(3)])).all()


def test_a_closed_door_makes_the_way_longer_or_ends_it() -> None:
    space = free_space([Room(0, 4, 0, 4), Room(4, 8, 0, 4)])
    a, b = space.nearest((1, 2)), space.nearest((7, 2))
    shut = space.without(space.within((4, 2), 1.0))
    assert np.isfinite(metres_between(space, [a, b])).all()
    assert np.isinf(metres_between(shut, [a, b])[0, 1])


def test_a_turn_in_the_middle_of_a_room_of_the_thesis_sees_less_than_half_of_it() -> None:
    with reference_world() as world:
        places = sorted(world.places(), key=lambda place: int(place.label.split()[1]))
    rooms = [Room(p.xmin, p.xmax, p.ymin, p.ymax) for p in places]
    space = free_space(rooms)

    def shares(reach: float) -> list[float]:
        found = []
        for number, room in enumerate(rooms):
            middle = ((room.xmin + room.xmax) / 2, (room.ymin + room.ymax) / 2)
            floor = space.floor(number)
            seen = visible_cells(space, space.nearest(middle, number), reach)[0]
            found.append(float(np.isin(floor, seen).mean()))
        return found

    far, near = shares(4.6), shares(2.8)
    assert np.mean(far) == pytest.approx(0.48, abs=0.015)
    assert np.mean(near) == pytest.approx(0.20, abs=0.015)
    assert far[0] == pytest.approx(0.14, abs=0.015)  # patio
    assert far[1] == pytest.approx(0.37, abs=0.015)  # kitchen


@pytest.mark.parametrize("east", [2e6, 1e308])
def test_rooms_that_no_grid_holds_are_refused(east: float) -> None:
    with pytest.raises(
        LayoutError, match=r"the places span .* correct their edges to within 2000 m"
    ):
        free_space([Room(-east, east, 0.0, 300.0, 0.0), Room(0.0, 3.0, 0.0, 3.0, 0.0)])


def test_a_layout_without_floor_is_refused() -> None:
    with pytest.raises(LayoutError, match="at least one room"):
        free_space([])
    with pytest.raises(LayoutError, match="no free floor"):
        FreeSpace(np.zeros(2), 0.2, np.full((3, 3), NO_ROOM, np.int32))
