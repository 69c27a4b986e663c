"""Random houses: a floor plan, furniture along its walls, and small things on the furniture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from lab.houses.floor_plans import Doorway, FloorPlan, PlanRectangle, draw_floor_plan
from lab.houses.furniture_groups import GROUPS, single
from lab.houses.room_furnisher import RoomFurnisher
from lab.houses.small_things import (
    FLOOR,
    IN_PAIRS,
    MEAN_COUNT,
    STANDS_ON,
    SurfaceSampler,
)
from planner.search.plans.thesis_rules import nearest_neighbour
from planner.simulation.house import (
    CHALK,
    OAK,
    OBJECTS,
    RGB,
    SLATE,
    WALNUT,
    FloorGrid,
    House,
    HouseRoom,
    Item,
    Wall,
)

PAIR: Final = 0.15  # probability that a thing of IN_PAIRS has a second one beside it
FULLNESS: Final = 1.3  # of a house, as a factor on MEAN_COUNT
TILED: Final = frozenset({"kitchen", "shower"})
_FLOORS: Final[tuple[RGB, ...]] = (OAK, WALNUT, (0.82, 0.68, 0.50), (0.70, 0.56, 0.44))


def random_house(seed: int) -> House:
    """A random furnished house by `seed`; every item has a unique name."""
    rng = np.random.default_rng([seed, 11])
    plan = draw_floor_plan(rng)
    rooms, walls = _rooms(plan, rng), walls_of(plan)
    items = list[Item]()
    furnishers = [RoomFurnisher(room, walls, rooms) for room in rooms]
    for furnisher in furnishers:
        for choice in GROUPS[furnisher.room.category]:
            if rng.random() < choice.probability:
                furnisher.place_choice(choice, rng)
        for label, mean in MEAN_COUNT[furnisher.room.category].items():
            if STANDS_ON[label] == (FLOOR,):
                for _ in range(_how_many(mean, rng)):
                    furnisher.place(single(label), "wall", rng)
        items += _in_matching_colours(furnisher.items, rng)
    items += _small_things(items, rooms, rng)
    targets = np.array([item.centre()[:2] for item in items if item.label in OBJECTS])
    rooms = [replace(f.room, viewpoints=f.viewpoints(targets)) for f in furnishers]
    return _in_tour_order(_assembled(rooms, walls, items))


def varied(item: Item, rng: np.random.Generator) -> Item:
    """`item` in random colours; its screen may be on."""
    hue, tone = float(rng.uniform(-0.08, 0.08)), float(rng.uniform(0.75, 1.15))
    if item.label in IN_PAIRS | {"backpack", "handbag", "suitcase", "couch", "vase"}:
        spread = 0.08 if item.label in ("apple", "orange") else 1.0
        hue = float(rng.uniform(-0.5, 0.5) * spread)
    return replace(item, hue=hue, tone=tone, lit=bool(rng.random() < 0.4))


def _in_matching_colours(items: Iterable[Item], rng: np.random.Generator) -> list[Item]:
    """Furniture of one room, all of a class in the same colours."""
    drawn: dict[str, Item] = {}
    out = list[Item]()
    for item in items:
        look = drawn.setdefault(item.label, varied(item, rng))
        out.append(replace(item, hue=look.hue, tone=look.tone, lit=look.lit))
    return out


def new_thing(label: str, rng: np.random.Generator) -> Item:
    """A small thing of random size and colours, without a position yet."""
    size = rng.uniform(0.85, 1.15) * rng.uniform(0.95, 1.05, 3)
    return varied(Item(label, 0, 0, scale=tuple(float(s) for s in size)), rng)  # type: ignore[arg-type]


def _small_things(
    items: Sequence[Item], rooms: Sequence[HouseRoom], rng: np.random.Generator
) -> list[Item]:
    sampler = SurfaceSampler(items)
    out = list[Item]()
    for room in rooms:
        here = [s for s in sampler.surfaces if room.contains(*((s.lo + s.hi) / 2))]
        for label, mean in MEAN_COUNT[room.category].items():
            on = [s for s in here if s.label in STANDS_ON[label]]
            for _ in range(_how_many(mean, rng)):
                placed = sampler.place(new_thing(label, rng), on, rng)
                if placed is None:
                    continue
                out.append(placed)
                if label in IN_PAIRS and rng.random() < PAIR:
                    second = sampler.beside(new_thing(label, rng), placed, rng)
                    out += [second] if second is not None else []
    return out


def _how_many(mean: float, rng: np.random.Generator) -> int:
    return min(int(rng.poisson(FULLNESS * mean)), int(mean) + 2)


def _in_tour_order(house: House) -> House:
    """The rooms in nearest-neighbour order along paths, beginning at a corridor if there is one."""
    floor = FloorGrid(house)

    def metres(here: HouseRoom | None, room: HouseRoom) -> float:
        if here is None:
            return float(room.category != "corridor")
        path = floor.path(np.array(here.viewpoints[-1]), np.array(room.viewpoints[0]))
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    return replace(house, rooms=tuple(nearest_neighbour(house.rooms, metres)))


def _assembled(rooms: Sequence[HouseRoom], walls: Sequence[Wall], items: Iterable[Item]) -> House:
    count: Counter[str] = Counter()
    named = list[Item]()
    for item in items:
        count[item.label] += 1
        named.append(replace(item, name=f"{item.label.replace(' ', '_')}_{count[item.label]}"))
    return House(
        tuple(rooms),
        tuple(walls),
        tuple(item for item in named if item.label in OBJECTS),
        tuple(item for item in named if item.label not in OBJECTS),
    )


def _rooms(plan: FloorPlan, rng: np.random.Generator) -> list[HouseRoom]:
    planks = _FLOORS[rng.integers(len(_FLOORS))]
    tiles = {"kitchen": SLATE, "shower": CHALK}
    count: Counter[str] = Counter()
    names = list[str]()
    for room in plan.rooms:
        count[room.category] += 1
        number = count[room.category]
        names.append(room.category if number == 1 else f"{room.category} {number}")
    return [
        HouseRoom(
            name=name,
            category=room.category,
            xmin=room.xmin / 10,
            xmax=room.xmax / 10,
            ymin=room.ymin / 10,
            ymax=room.ymax / 10,
            floor="tiles" if room.category in TILED else "planks",
            floor_colour=tiles.get(room.category, planks),
            viewpoints=(),
            part_of="" if room.part_of is None else names[room.part_of],
        )
        for name, room in zip(names, plan.rooms, strict=True)
    ]


def walls_of(plan: FloorPlan) -> list[Wall]:
    """Walls along all sides of the rooms, interrupted by doorways; none inside L-shaped rooms."""
    sides: dict[tuple[bool, int], list[tuple[int, int]]] = {}
    for room in plan.rooms:
        for across_x, at, low, high in _sides(room):
            sides.setdefault((across_x, at), []).append((low, high))
    walls = list[Wall]()
    for (across_x, at), intervals in sorted(sides.items()):
        here = [d for d in plan.doorways if (d.across_x, d.at) == (across_x, at)]
        for low, high in _without(_merged(intervals), [d for d in here if not d.lintel]):
            inside = sorted((d.low, d.high) for d in here if d.lintel and low <= d.low < high)
            walls.append(_wall(across_x, at, low, high, inside))
    return walls


def _sides(room: PlanRectangle) -> list[tuple[bool, int, int, int]]:
    return [
        (True, room.xmin, room.ymin, room.ymax),
        (True, room.xmax, room.ymin, room.ymax),
        (False, room.ymin, room.xmin, room.xmax),
        (False, room.ymax, room.xmin, room.xmax),
    ]


def _merged(intervals: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    out = list[tuple[int, int]]()
    for low, high in sorted(intervals):
        if out and low <= out[-1][1]:
            out[-1] = out[-1][0], max(high, out[-1][1])
        else:
            out.append((low, high))
    return out


def _without(intervals: list[tuple[int, int]], gaps: list[Doorway]) -> list[tuple[int, int]]:
    for gap in gaps:
        cut = [((a, min(b, gap.low)), (max(a, gap.high), b)) for a, b in intervals]
        intervals = [(a, b) for parts in cut for a, b in parts if a < b]
    return intervals


def _wall(across_x: bool, at: int, low: int, high: int, doors: list[tuple[int, int]]) -> Wall:
    openings = tuple((a / 10, b / 10) for a, b in doors)
    if across_x:
        return Wall((at / 10, low / 10), (at / 10, high / 10), openings)
    return Wall((low / 10, at / 10), (high / 10, at / 10), openings)
