"""Planning on the floor as depth showed it: real doors, furniture, and what lies beyond."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Area
from kg.model.records import (
    FREE,
    LOW,
    TALL,
    UNKNOWN,
    DoorRecord,
    FloorTile,
    MapUpdate,
    PlaceRecord,
    RobotRecord,
)
from kg.serving.opening import in_memory_map
from mapping.occupancy.mapped_floor import mapped_floor
from planner.freespace.floor_plan import SeenSpace, free_space, seen_space, with_frontiers
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import NO_ROOM, FreeSpace, visible_cells
from planner.freespace.planning_map import PlanningMap
from planner.search.plans.report import step_lines
from planner.search.plans.route import route
from planner.search.plans.search_state import PlanningState, build_search
from planner.search.plans.search_viewpoints import search_viewpoints
from planner.search.plans.view_plan import plan
from planner.search.viewpoints.candidate_views import Sensor
from planner.search.viewpoints.covering_viewpoints import covering_viewpoints
from planner.settings import BELIEF, MAX_FLOOR, MAX_ROOMS

SIDE = 64
CELL = 0.05
LEFT, RIGHT = Area(0.0, 4.0, 0.0, 4.0), Area(4.0, 8.0, 0.0, 4.0)


class Drawing:
    """A floor drawn by rectangles [m], as tiles."""

    def __init__(self) -> None:
        self.states = np.full((4 * SIDE, 3 * SIDE), UNKNOWN, np.uint8)  # x -3.2..9.6, y -3.2..6.4

    def draw(self, x: tuple[float, float], y: tuple[float, float], state: int) -> Drawing:
        i, j = ((np.rint((np.array(pair) + SIDE * CELL) / CELL)).astype(int) for pair in (x, y))
        self.states[i[0] : i[1], j[0] : j[1]] = state
        return self

    def tiles(self) -> tuple[FloorTile, ...]:
        return tuple(
            FloorTile(0, column - 1, row - 1, 0.0, CELL, cells, 1e9)
            for column, columns in enumerate(np.split(self.states, 4))
            for row, cells in enumerate(np.split(columns, 3, axis=1))
        )


def two_rooms() -> Drawing:
    """Walls all around and between, with one door near the lower wall: y 0.6 to 1.6."""
    drawing = Drawing().draw((0.0, 8.0), (0.0, 4.0), TALL)
    drawing.draw((0.1, 3.95), (0.1, 3.9), FREE).draw((4.05, 7.9), (0.1, 3.9), FREE)
    return drawing.draw((3.9, 4.1), (0.6, 1.6), FREE)


def space_of(drawing: Drawing, *rooms: Area) -> SeenSpace:
    floor = mapped_floor(drawing.tiles())
    assert floor is not None
    return seen_space(free_space(rooms), rooms, floor)


def metres(space: FreeSpace, a: tuple[float, float], b: tuple[float, float]) -> float:
    (field,) = distance_fields(space, [space.nearest(a)])
    return float(field.reshape(-1)[space.nearest(b)])


def test_the_way_leads_through_the_door_that_was_seen() -> None:
    assumed = free_space([LEFT, RIGHT])
    seen = space_of(two_rooms(), LEFT, RIGHT).space
    above = (3.5, 3.5), (4.5, 3.5)
    noisy = two_rooms().draw((4.0, 4.05), (1.0, 1.05), TALL)
    assert metres(space_of(noisy, LEFT, RIGHT).space, (3.0, 1.0), (5.0, 1.0)) < 2.3  # a speck
    assert metres(assumed, *above) < 4.2  # by the middle of the wall
    assert 4.0 < metres(seen, *above) < 5.6  # down to the door, and up again
    gap = abs(seen.centres([seen.nearest((4.0, 2.0))])[0, 0] - 4.0)
    assert gap > 0.15  # where a door was assumed there is wall


def test_a_door_that_was_seen_shut_is_shut_and_the_room_behind_it_still_planned_for() -> None:
    shut = two_rooms().draw((3.9, 4.1), (0.6, 1.6), TALL)
    space = space_of(shut, LEFT, RIGHT).space
    cells, _ = visible_cells(space, space.nearest((3.0, 1.1)), 4.6)
    assert space.centres(cells)[:, 0].max() < 4.0
    assert len(space.passages) == 1
    assert np.isfinite(metres(space, (2.0, 2.0), (6.0, 2.0)))


def test_one_looks_over_a_table_and_walks_around_it() -> None:
    table = two_rooms().draw((1.6, 2.4), (0.1, 3.0), LOW)
    space = space_of(table, LEFT, RIGHT).space
    bare = space_of(two_rooms(), LEFT, RIGHT).space
    assert metres(space, (1.0, 1.0), (3.0, 1.0)) > metres(bare, (1.0, 1.0), (3.0, 1.0)) + 2.0
    cells, _ = visible_cells(space, space.nearest((1.0, 1.0)), 4.6)
    spots = space.centres(cells)
    assert ((abs(spots - (2.0, 1.0))).max(axis=1) < 0.15).any()  # its top
    assert ((abs(spots - (3.0, 1.0))).max(axis=1) < 0.15).any()  # the floor beyond
    cupboard = space_of(two_rooms().draw((1.6, 2.4), (0.1, 3.0), TALL), LEFT, RIGHT).space
    cells, _ = visible_cells(cupboard, cupboard.nearest((1.0, 1.0)), 4.6)
    assert not ((abs(cupboard.centres(cells) - (3.0, 1.0))).max(axis=1) < 0.15).any()
    on_top = space.inside()[np.isin(space.inside(), space.floor(), invert=True)]
    assert len(on_top) and set(space.room.reshape(-1)[on_top]) == {0}  # things may lie there


def test_where_nobody_looked_rectangles_and_assumed_doors_count() -> None:
    half = two_rooms().draw((3.0, 8.0), (0.0, 4.0), UNKNOWN)
    seen = space_of(half, LEFT, RIGHT)
    space = seen.space
    assert {int(space.room.reshape(-1)[space.nearest(p)]) for p in ((1, 1), (6, 2))} == {0, 1}
    assert np.isfinite(metres(space, (1.0, 1.0), (6.0, 2.0))) and not space.passages
    here, there = (seen.states.reshape(-1)[space.nearest(p)] for p in ((1, 1), (6, 2)))
    assert (here, there) == (FREE, UNKNOWN)


def test_what_a_rectangle_holds_outside_of_the_walls_is_no_floor() -> None:
    around = Area(-3.0, 9.0, -3.0, 6.0)  # as it grows around a recording without a layout
    space = space_of(two_rooms(), around).space
    spots = space.centres(space.floor())
    assert spots.min() > 0.0 and spots[:, 0].max() < 8.0 and spots[:, 1].max() < 4.0
    assert not space.passages


@pytest.mark.parametrize(("wall", "is_floor"), [(3.4, False), (2.4, True)])
def test_unseen_floor_behind_a_wall_is_floor_where_a_robot_fits(wall, is_floor):
    drawing = (
        Drawing().draw((0.0, 4.0), (0.0, wall), FREE).draw((0.0, 3.6), (wall, wall + 0.2), TALL)
    )
    space = space_of(drawing, LEFT).space
    x, y = space.centres(space.floor()).T
    assert bool(((x < 3.0) & (y > wall + 0.2)).any()) == is_floor


def test_a_room_of_tables_alone_is_seen_from_the_floor_of_others() -> None:
    table = Area(5.8, 7.9, 1.8, 3.9)
    drawing = two_rooms().draw((5.7, 8.0), (1.7, 4.0), LOW).draw((7.9, 8.0), (0.0, 4.0), TALL)
    space = space_of(drawing.draw((0.0, 8.0), (3.9, 4.0), TALL), LEFT, RIGHT, table).space
    assert not len(space.floor(2)) and len(space.inside(2)) > 50
    reach, near = 2.0, 0.8
    viewpoints = covering_viewpoints(space, reach, near=near, covers=1)
    assert space.free.reshape(-1)[viewpoints].all()
    shown = [visible_cells(space, int(viewpoint), reach) for viewpoint in viewpoints]
    seen = {int(c) for cells, off in shown for c in cells[np.hypot(*off.T) >= near]}
    every = [visible_cells(space, int(viewpoint), reach) for viewpoint in space.floor()]
    seeable = {int(c) for cells, off in every for c in cells[np.hypot(*off.T) >= near]}
    assert set(space.inside(2).tolist()) & seeable <= seen


def test_a_floor_far_from_all_places_is_not_planned_on(semantic_map: SemanticMap) -> None:
    away = [replace(tile, column=tile.column + 10**5) for tile in hall().tiles()]
    nodes = "DELETE { ?t ?p ?o } WHERE { ?t a here:FloorTile ; ?p ?o }"
    semantic_map.update(nodes, by="Ada")
    semantic_map.apply(MapUpdate(floor=tuple(away)))
    state = state_for(semantic_map, "bed")
    assert {c.kind for c in state.candidates} == {"place"}
    assert state.space.shape < (100, 100)


def hall() -> Drawing:
    """One room, of which a door in the upper wall leads on: x 1.5 to 2.5."""
    drawing = Drawing().draw((0.0, 4.0), (0.0, 4.0), TALL).draw((0.1, 3.9), (0.1, 3.9), FREE)
    return drawing.draw((1.5, 2.5), (3.9, 4.3), FREE)


def frontiers_of(drawing: Drawing) -> tuple[SeenSpace, int]:
    floor = mapped_floor(drawing.tiles())
    assert floor is not None
    seen, found = with_frontiers(seen_space(free_space([LEFT]), [LEFT], floor, margin=2.8))
    return seen, len(found)


def test_beyond_an_open_door_floor_is_assumed() -> None:
    seen, count = frontiers_of(hall())
    assert count == 1
    space = seen.space
    beyond = space.nearest((2.0, 5.5))
    assert np.linalg.norm(space.centres([beyond])[0] - (2.0, 5.5)) < 0.2
    assert int(space.room.reshape(-1)[beyond]) == 2  # 0: the place, 1: floor in no place
    assert metres(space, (2.0, 2.0), (2.0, 5.5)) < 4.0


@pytest.mark.parametrize(
    "drawing",
    [
        hall().draw((1.5, 2.5), (4.3, 4.4), TALL),  # the door is shut
        hall().draw((1.5, 2.1), (3.9, 4.3), TALL),  # too narrow for a robot
        hall().draw((1.0, 3.0), (5.0, 5.1), TALL).draw((0.9, 1.0), (4.0, 5.1), TALL)
        .draw((3.0, 3.1), (4.0, 5.1), TALL),  # a cupboard
    ],
    ids=["shut", "narrow", "closet"],
)  # fmt: skip
def test_what_leads_nowhere_is_no_frontier(drawing: Drawing) -> None:
    assert frontiers_of(drawing)[1] == 0


@pytest.fixture
def semantic_map() -> SemanticMap:
    made = in_memory_map(title="hall", base="https://example.org/hall/")
    kind = made.catalogue.find("kitchen", "place").iri
    made.apply(
        MapUpdate(
            places=(PlaceRecord(made.place_iri(1), "place 1", 0, 4, 0, 4, 9, {kind: 0.9}),),
            robot=RobotRecord(np.array([2.0, 1.0, 1.2]), 0.0, 1e9),
            floor=hall().tiles(),
        )
    )
    return made


def state_for(semantic_map: SemanticMap, target: str) -> PlanningState:
    state = build_search(semantic_map, [target])
    assert state is not None
    return state


def test_a_search_goes_to_see_what_nobody_has_seen(semantic_map: SemanticMap) -> None:
    state = state_for(semantic_map, "bed")
    (frontier,) = [c for c in state.candidates if c.kind == "frontier"]
    assert frontier.iri == "https://example.org/hall/floor/0/0_1#frontier-1"
    assert 0 < frontier.probability < BELIEF.frontier
    found = plan(state, (2.0, 1.0), trials=0, worth=0.0)
    beyond = [step for step in found.steps if step.p_map[1] > 4.0]
    assert beyond
    words = "\n".join(step_lines(beyond))
    assert re.search(r"the area beyond \((1\.9|2\.1), 4\.[123]\) was never seen", words)
    assert "a room begins there with 30 %" in words
    (goal,) = [g for g in found.goals if g.candidate.kind == "frontier"]
    assert goal.seconds is not None


def test_what_was_not_seen_of_a_room_holds_more(semantic_map: SemanticMap) -> None:
    def belief(drawing: Drawing) -> tuple[float, float, str]:
        semantic_map.apply(MapUpdate(floor=drawing.tiles()))
        state = state_for(semantic_map, "cup")
        (place,) = [c for c in state.candidates if c.kind == "place"]
        of_cell = dict(zip(state.views.cells.tolist(), state.belief.weight, strict=True))
        near, far = (state.space.nearest(p) for p in ((1.0, 1.0), (3.4, 1.0)))
        return place.probability, of_cell[far] / of_cell[near], place.facts[-1]

    whole, even, _ = belief(hall())
    part, ratio, said = belief(hall().draw((3.0, 4.0), (0.0, 4.0), UNKNOWN))
    assert part > whole
    assert even == pytest.approx(1.0, rel=1e-6)
    assert ratio > 1.5
    assert "% of its floor seen" in said


def test_a_place_that_turned_out_to_be_all_wall_holds_the_others_up_in_nothing(semantic_map):
    kind = semantic_map.catalogue.find("kitchen", "place").iri
    solid = PlaceRecord(semantic_map.place_iri(2), "pillar", 1, 1.6, 1, 1.6, 9, {kind: 0.9})
    walled = hall().draw((0.9, 1.7), (0.9, 1.7), TALL)
    semantic_map.apply(MapUpdate(places=(solid,), floor=walled.tiles()))
    state = state_for(semantic_map, "cup")
    assert all(0 <= c.probability <= 1 for c in state.candidates)
    assert 0 < state.left < 1


def test_walls_of_one_cell_hold_robot_and_eye() -> None:
    for y in np.linspace(0.13, 3.87, 9):  # however they lie to the cells that are planned on
        drawing = Drawing().draw((0.0, 8.0), (0.0, 4.0), FREE).draw((0.0, 8.0), (y, y + 0.05), TALL)
        space = space_of(drawing, Area(0.0, 8.0, 0.0, 4.0)).space
        wall = space.room == NO_ROOM
        assert wall.any(axis=1)[1:-1].all()


def of_tables(number: int) -> FloorTile:
    """A tile with something to look over everywhere but in one small cell."""
    cells = np.full((SIDE, SIDE), LOW, np.uint8)
    cells[0, 0] = FREE
    return FloorTile(0, number, 0, 0.0, CELL, cells, 1e9)


def test_a_floor_without_a_place_to_stand_is_taken_for_what_its_rectangles_say() -> None:
    side = SIDE * CELL
    with in_memory_map() as semantic_map:
        kitchen = semantic_map.catalogue.find("kitchen", "place").iri
        room = PlaceRecord(semantic_map.place_iri(1), "room", 0, side, 0, side, 9, {kitchen: 0.9})
        robot = RobotRecord(np.array([1.0, 1.0, 1.2]), 0.0, 1e9)
        semantic_map.apply(MapUpdate(places=(room,), floor=(of_tables(0),), robot=robot))
        state = build_search(semantic_map, ["banana"])
    assert state is not None
    assert state.space.free.any()
    assert len(state.views.viewpoints)


@pytest.mark.parametrize("tables", [10, MAX_ROOMS + 9])
def test_many_rooms_of_tables_are_looked_at_from_where_one_can_stand(tables: int) -> None:
    rooms = tables + 3  # of 5 x 5 cells in a row, open to each other; in the last three is floor
    room = np.repeat(np.arange(rooms, dtype=np.int32), 5)[:, None].repeat(5, axis=1)
    space = FreeSpace(np.zeros(2), 0.2, room, low=room < tables)
    names = tuple(f"room {n}" for n in range(rooms))
    cells = space.inside()
    weight = np.where(room.reshape(-1)[cells] < tables, 1.0, 0.001)  # it is on one of the tables
    viewpoints = search_viewpoints(PlanningMap(space, names, names), cells, weight, Sensor())
    assert set(space.room.reshape(-1)[viewpoints]) <= set(range(tables, rooms))
    seen = {
        int(room.reshape(-1)[c])
        for viewpoint in viewpoints
        for c in visible_cells(space, int(viewpoint), 4.6)[0]
    }
    assert tables - 1 in seen, "tables beside the floor are seen from it"


def test_of_a_hall_the_part_around_the_thing_is_looked_at() -> None:
    side = 400  # cells, 80 m
    space = FreeSpace(np.zeros(2), 0.2, np.zeros((side, side), np.int32))
    cells = space.inside()
    weight = np.zeros(len(cells))
    weight[space.nearest((60.0, 20.0))] = 1.0
    plan_of = PlanningMap(space, ("hall",), ("hall",))
    viewpoints = search_viewpoints(plan_of, cells, weight, Sensor(), covers=1)
    off = np.hypot(*(space.centres(viewpoints) - (60.0, 20.0)).T)
    assert len(viewpoints)
    assert off.max() <= np.sqrt(MAX_FLOOR / np.pi) + 1


@pytest.mark.parametrize(("y", "through"), [(1.1, True), (3.5, False)])
def test_a_route_has_its_unseen_part_and_the_door_that_it_leads_through(semantic_map, y, through):
    drawing = two_rooms().draw((4.5, 7.9), (0.1, 3.9), UNKNOWN)
    rooms = [
        PlaceRecord(semantic_map.place_iri(n), f"room {n}", r.xmin, r.xmax, r.ymin, r.ymax)
        for n, r in enumerate((LEFT, RIGHT), 1)
    ]
    ends = (rooms[0].iri, rooms[1].iri)
    door = DoorRecord(f"{semantic_map.base}door/1-2", 4.0, y, 0.9, ends)
    semantic_map.apply(MapUpdate(places=tuple(rooms), floor=drawing.tiles(), doors=(door,)))
    found = route(semantic_map, (1.0, 1.1), (7.0, 1.1))
    assert found is not None
    assert found.metres == pytest.approx(6.0, abs=0.5)
    assert found.unseen == pytest.approx(2.5, abs=0.4)
    (crossing,) = found.crossings
    assert tuple(place.iri for place in crossing.places) == ends
    assert (crossing.door is not None) == through
