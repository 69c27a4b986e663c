from itertools import combinations, pairwise

import numpy as np
import pytest

from kg.serving.opening import in_memory_map
from lab.houses.floor_plans import LAYOUTS, FloorPlan, draw_floor_plan
from lab.houses.house_changes import Carry, carries, changed_house
from lab.houses.random_house import random_house, walls_of
from lab.houses.small_things import MOVABLE, STANDS_ON, SURFACES
from lab.recordings.object_truth import supporting
from planner.simulation.camera import CameraModel
from planner.simulation.house import FloorGrid, House
from planner.simulation.house_robot import TimedPose

SEEDS = range(12)


@pytest.fixture(scope="module")
def houses() -> list[House]:
    return [random_house(seed) for seed in SEEDS]


def plans(count: int) -> list[FloorPlan]:
    return [draw_floor_plan(np.random.default_rng(seed)) for seed in range(count)]


# floor plans


def test_forty_plans_have_at_least_twenty_shapes_and_every_layout() -> None:
    drawn = plans(40)
    shapes = {
        (plan.layout, len(plan.rooms), frozenset(frozenset(d.rooms) for d in plan.doorways))
        for plan in drawn
    }
    assert len(shapes) >= 20
    assert {plan.layout for plan in drawn} == set(LAYOUTS)


def test_rooms_of_a_plan_do_not_overlap_and_some_are_l_shaped() -> None:
    drawn = plans(40)
    for plan in drawn:
        for a, b in combinations(plan.rooms, 2):
            apart = a.xmax <= b.xmin or b.xmax <= a.xmin or a.ymax <= b.ymin or b.ymax <= a.ymin
            assert apart, (plan.layout, a, b)
    assert any(room.part_of is not None for plan in drawn for room in plan.rooms)


def test_every_doorway_is_a_gap_in_a_wall() -> None:
    for plan in plans(20):
        walls = walls_of(plan)
        for door in plan.doorways:
            middle = (door.low + door.high) / 20
            spot = (door.at / 10, middle) if door.across_x else (middle, door.at / 10)
            solids = [s for wall in walls for s in wall.solids() if s.lo[2] == 0]
            blocked = [s for s in solids if np.all((s.lo[:2] < spot) & (s.hi[:2] > spot))]
            assert not blocked, (plan.layout, door)


# furniture


def test_the_same_seed_gives_the_same_house_and_another_another() -> None:
    assert random_house(3) == random_house(3)
    assert random_house(3) != random_house(4)


def test_every_room_can_be_reached_from_every_other(houses: list[House]) -> None:
    for house in houses:
        floor = FloorGrid(house)
        reached = floor.centres(floor.reachable(np.array(house.rooms[0].viewpoints[0])))
        for room in house.rooms:
            for viewpoint in room.viewpoints:
                assert room.contains(*viewpoint)
                assert np.linalg.norm(reached - viewpoint, axis=1).min() < 0.15


def test_houses_hold_dozens_of_named_things_inside_their_rooms(houses: list[House]) -> None:
    catalogue = in_memory_map().catalogue
    for house in houses:
        items = [*house.objects, *house.furnishings]
        assert len({item.name for item in items}) == len(items)
        assert 25 <= len(house.objects) <= 120
        assert len({item.label for item in house.objects}) >= 12
        for item in items:
            assert house.room_at(*item.centre()[:2]) is not None, item
        for item in house.objects:
            assert catalogue.find(item.label, "object").label == item.label


def test_small_things_stand_on_furniture_and_not_in_each_other(houses: list[House]) -> None:
    for house in houses:
        small = [
            o for o in house.objects if o.label in MOVABLE and STANDS_ON[o.label][0] != "floor"
        ]
        assert len(small) >= 8
        furniture = {o.name: o for o in (*house.objects, *house.furnishings)}
        for item in small:
            if item.label not in ("laptop", "keyboard", "mouse"):
                assert furniture[supporting(item, house)].label in SURFACES
        for a, b in combinations(small, 2):
            (a_lo, a_hi), (b_lo, b_hi) = a.bounds(), b.bounds()
            assert np.any(a_hi <= b_lo + 1e-9) or np.any(b_hi <= a_lo + 1e-9), (a, b)


def test_some_things_of_one_class_stand_side_by_side(houses: list[House]) -> None:
    away = [
        float(np.linalg.norm(a.centre() - b.centre()))
        for house in houses
        for a, b in combinations(house.objects, 2)
        if a.label == b.label and a.label in MOVABLE
    ]
    assert sum(0.2 < distance < 0.45 for distance in away) >= 3


# the next session


def test_a_fifth_of_the_small_things_move_and_keep_their_names(houses: list[House]) -> None:
    for house in houses:
        change = changed_house(house, np.random.default_rng(5))
        before = {item.name: item for item in house.objects}
        after = {item.name: item for item in change.house.objects}
        small = [item for item in house.objects if item.label in MOVABLE]
        moved = {n for n in before.keys() & after.keys() if before[n] != after[n]}
        assert moved == change.moved
        assert 0.1 * len(small) <= len(moved) <= 0.3 * len(small) + 2
        assert {item.name for item in change.vanished} == before.keys() - after.keys() != set()
        assert change.new == after.keys() - before.keys() != set()
        for name in moved:
            assert np.linalg.norm(before[name].centre() - after[name].centre()) > 0.2
            assert before[name].label == after[name].label


def test_a_carried_thing_goes_from_its_old_place_to_its_new_one(houses: list[House]) -> None:
    house = houses[0]
    change = changed_house(house, np.random.default_rng(5))
    poses = [
        TimedPose(x, y, heading, k) for k, (x, y, heading) in enumerate([(2, 2, 0.0), (3, 2, 1.0)])
    ]
    moving, drive = carries(house, change, poses, CameraModel(), start=100.0)
    assert len(drive) > len(poses) and all(a.seconds < b.seconds for a, b in pairwise(drive))
    assert {change.house.objects[carry.index].name for carry in moving} == change.carried
    old = {item.name: item for item in house.objects}
    for carry in moving:
        item = change.house.objects[carry.index]
        origin = old[item.name]
        at_first = np.array([item.x, item.y, item.z]) + carry.offset(carry.start - 1)
        assert np.allclose(at_first, (origin.x, origin.y, origin.z))
        metres = float(np.linalg.norm(np.diff(carry.path, axis=0), axis=1).sum())
        end = carry.start + metres / carry.speed
        assert np.allclose(carry.offset(end), 0)
        half_way = item.z + carry.offset((carry.start + end) / 2)[2]
        assert half_way == pytest.approx(1.1)


def test_a_carry_moves_at_its_speed() -> None:
    carry = Carry(0, np.array([[0.0, 0, 0], [2.0, 0, 0]]), start=10.0, speed=0.5)
    assert carry.offset(12.0).tolist() == [-1.0, 0.0, 0.0]
    assert carry.offset(13.9).any() and not carry.offset(14.0).any()
