"""Random floor plans: rectangular rooms that touch, their categories, and doorways between them.

Lengths are whole decimetres while a plan is drawn, so that rooms share walls exactly. A plan is one
of several layouts (`LAYOUTS`), turned and mirrored at random. Some rooms are L-shaped: two
rectangles without a wall between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Final

import numpy as np

DOOR: Final = 9  # [dm] width of a doorway
JAMB: Final = 2  # [dm] wall kept beside a doorway, at least
MIN_SIDE: Final = 24  # [dm] of a room
MAX_ROOM: Final = 2400  # [dm^2] larger rectangles are split
MIN_CATEGORIES: Final = 4  # of rooms in a house
OPEN_PLAN: Final = frozenset({"living room", "dining room", "kitchen"})
#: Categories of the rooms of a house, the most needed first.
PURPOSES: Final = (
    *("living room", "kitchen", "shower", "bedroom", "dining room", "home office"),
    *("bedroom", "bedroom", "shower", "home office", "bedroom"),
)


@dataclass(frozen=True, slots=True)
class PlanRectangle:
    """A room, or a part of an L-shaped one [dm]."""

    xmin: int
    xmax: int
    ymin: int
    ymax: int
    category: str = ""  # "" until one is chosen
    part_of: int | None = None  # number of the rectangle with which it forms one room

    @property
    def area(self) -> int:
        """[dm^2]."""
        return (self.xmax - self.xmin) * (self.ymax - self.ymin)


@dataclass(frozen=True, slots=True)
class Doorway:
    """An opening between two rectangles, in the wall at `at` across x or y [dm]."""

    rooms: tuple[int, int]
    across_x: bool  # whether the way through it is along x
    at: int
    low: int  # along the wall
    high: int
    lintel: bool = True  # False: no wall at all, the two are one room


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """Rectangles that touch, and the openings between them; all are connected."""

    layout: str  # one of LAYOUTS
    rooms: tuple[PlanRectangle, ...]
    doorways: tuple[Doorway, ...]


def draw_floor_plan(rng: np.random.Generator) -> FloorPlan:
    """A plan of four to a dozen rooms, each reachable from each."""
    while True:
        layout = sorted(LAYOUTS)[rng.integers(len(LAYOUTS))]
        rooms = _turned(LAYOUTS[layout](rng), rng)
        rooms = _with_purposes(_with_l_shape(rooms, rng), rng)
        doorways = _doorways(rooms, rng)
        if doorways is not None and len({r.category for r in rooms}) >= MIN_CATEGORIES:
            return FloorPlan(layout, tuple(rooms), tuple(doorways))


# layouts


def _central_corridor(rng: np.random.Generator) -> list[PlanRectangle]:
    """Rooms on both sides of a corridor; one more may lie across its end."""
    length, width = _between(rng, 80, 125), _between(rng, 13, 17)
    lower, upper = _between(rng, 31, 43), _between(rng, 31, 43)
    height = lower + width + upper
    rooms = [PlanRectangle(0, length, lower, lower + width, "corridor")]
    rooms += _row(rng, 0, length, 0, lower)
    rooms += _row(rng, 0, length, lower + width, height)
    if rng.random() < 0.4:
        rooms.append(PlanRectangle(length, length + _between(rng, 30, 42), 0, height))
    return rooms


def _one_sided_corridor(rng: np.random.Generator) -> list[PlanRectangle]:
    """A corridor along an outer wall, a row of rooms, and a large room across."""
    length, width, depth = _between(rng, 75, 115), _between(rng, 13, 16), _between(rng, 33, 45)
    side = _between(rng, 36, 48)
    rooms = [PlanRectangle(0, length, 0, width, "corridor")]
    rooms += _row(rng, 0, length, width, width + depth)
    rooms += _split(rng, PlanRectangle(length, length + side, 0, width + depth))
    return rooms


def _bent_corridor(rng: np.random.Generator) -> list[PlanRectangle]:
    """An L-shaped corridor with rooms around it."""
    length, width = _between(rng, 90, 115), _between(rng, 13, 16)
    lower, upper = _between(rng, 31, 42), _between(rng, 36, 52)
    bend, top = _between(rng, 34, length - 50), lower + width + upper
    return [
        PlanRectangle(0, length, lower, lower + width, "corridor"),
        PlanRectangle(bend, bend + width, lower + width, top, "corridor", 0),
        *_row(rng, 0, length, 0, lower),
        *_split(rng, PlanRectangle(0, bend, lower + width, top)),
        *_split(rng, PlanRectangle(bend + width, length, lower + width, top)),
    ]


def _recursive_splits(rng: np.random.Generator) -> list[PlanRectangle]:
    """A rectangle, split until no room is too large; no corridor."""
    return _split(rng, PlanRectangle(0, _between(rng, 75, 110), 0, _between(rng, 65, 95)))


def _l_outline(rng: np.random.Generator) -> list[PlanRectangle]:
    """A house of two wings that form an L."""
    length, depth = _between(rng, 80, 110), _between(rng, 40, 62)
    wing = _between(rng, 38, 50)
    rooms = _split(rng, PlanRectangle(0, length, 0, depth))
    return rooms + _split(rng, PlanRectangle(0, wing, depth, depth + _between(rng, 40, 62)))


def _u_outline(rng: np.random.Generator) -> list[PlanRectangle]:
    """Two wings on a corridor, a yard between them."""
    length, width, depth = _between(rng, 95, 125), _between(rng, 13, 16), _between(rng, 31, 40)
    left, right, wing = (_between(rng, low, high) for low, high in ((32, 40), (32, 40), (36, 60)))
    start = depth + width
    return [
        PlanRectangle(0, length, depth, start, "corridor"),
        *_row(rng, 0, length, 0, depth),
        *_split(rng, PlanRectangle(0, left, start, start + wing)),
        *_split(rng, PlanRectangle(length - right, length, start, start + wing)),
    ]


def _pinwheel(rng: np.random.Generator) -> list[PlanRectangle]:
    """Four parts around a hall; each may be split."""
    x0, y0 = _between(rng, 32, 44), _between(rng, 32, 44)
    x1, y1 = x0 + _between(rng, 22, 32), y0 + _between(rng, 22, 32)
    x2, y2 = x1 + _between(rng, 32, 44), y1 + _between(rng, 32, 44)
    rooms = [PlanRectangle(x0, x1, y0, y1, "corridor")]
    for part in ((0, x1, 0, y0), (x1, x2, 0, y1), (x0, x2, y1, y2), (0, x0, y0, y2)):
        rooms += _split(rng, PlanRectangle(*part))
    return rooms


LAYOUTS: Final[dict[str, Callable[[np.random.Generator], list[PlanRectangle]]]] = {
    "bent corridor": _bent_corridor,
    "central corridor": _central_corridor,
    "l outline": _l_outline,
    "one-sided corridor": _one_sided_corridor,
    "pinwheel": _pinwheel,
    "recursive splits": _recursive_splits,
    "u outline": _u_outline,
}


def _between(rng: np.random.Generator, low: int, high: int) -> int:
    return int(rng.integers(low, high + 1))


def _row(
    rng: np.random.Generator, xmin: int, xmax: int, ymin: int, ymax: int
) -> list[PlanRectangle]:
    """Rooms side by side from xmin to xmax."""
    length = xmax - xmin
    count = _between(rng, max(2, -(-length // 50)), max(2, length // 30))
    while True:
        cuts = np.sort(rng.integers(MIN_SIDE, length - MIN_SIDE + 1, count - 1))
        edges = [0, *(int(cut) for cut in cuts), length]
        if min(np.diff(edges)) >= MIN_SIDE and max(np.diff(edges)) <= 58:
            break
    return [PlanRectangle(xmin + a, xmin + b, ymin, ymax) for a, b in pairwise(edges)]


def _split(rng: np.random.Generator, room: PlanRectangle) -> list[PlanRectangle]:
    """`room` cut across its longer side again and again, until the parts have a room's size."""
    width, height = room.xmax - room.xmin, room.ymax - room.ymin
    longer = max(width, height)
    small = room.area < MAX_ROOM and longer < 58
    if longer < 2 * MIN_SIDE + 4 or (small and (room.area < 1400 or rng.random() < 0.6)):
        return [room]
    cut = _between(rng, MIN_SIDE + 2, longer - MIN_SIDE - 2)
    if width >= height:
        parts = replace(room, xmax=room.xmin + cut), replace(room, xmin=room.xmin + cut)
    else:
        parts = replace(room, ymax=room.ymin + cut), replace(room, ymin=room.ymin + cut)
    return [*_split(rng, parts[0]), *_split(rng, parts[1])]


def _turned(rooms: Sequence[PlanRectangle], rng: np.random.Generator) -> list[PlanRectangle]:
    """The plan turned by a quarter and mirrored, each at random."""
    quarter, mirrored = rng.random(2) < 0.5
    xmax, ymax = max(r.xmax for r in rooms), max(r.ymax for r in rooms)
    if mirrored:
        rooms = [replace(r, xmin=xmax - r.xmax, xmax=xmax - r.xmin) for r in rooms]
    if quarter:
        return [
            replace(r, xmin=ymax - r.ymax, xmax=ymax - r.ymin, ymin=r.xmin, ymax=r.xmax)
            for r in rooms
        ]
    return list(rooms)


# purposes


def _with_l_shape(rooms: list[PlanRectangle], rng: np.random.Generator) -> list[PlanRectangle]:
    """`rooms` with two of them joined to an L-shaped room, in half of the houses."""
    if rng.random() < 0.5 or len(rooms) < 6:
        return rooms
    pairs = [
        (a, b)
        for a, b in combinations(range(len(rooms)), 2)
        if not rooms[a].category and not rooms[b].category and _joins_to_l(rooms[a], rooms[b])
    ]
    if not pairs:
        return rooms
    a, b = pairs[rng.integers(len(pairs))]
    if rooms[a].area < rooms[b].area:
        a, b = b, a
    return [replace(room, part_of=a) if k == b else room for k, room in enumerate(rooms)]


def _joins_to_l(a: PlanRectangle, b: PlanRectangle) -> bool:
    """Whether the shared wall is all of one room's side and not all of the other's."""
    wall = _shared_wall(a, b)
    if wall is None or a.area + b.area > 1.6 * MAX_ROOM:
        return False
    across_x, _, low, high = wall
    sides = [(r.ymax - r.ymin) if across_x else (r.xmax - r.xmin) for r in (a, b)]
    return high - low == min(sides) and max(sides) - min(sides) >= 10


def _with_purposes(rooms: list[PlanRectangle], rng: np.random.Generator) -> list[PlanRectangle]:
    """Each room with a category: the largest the living room, the smallest the bathroom."""
    area = {
        k: room.area + sum(r.area for r in rooms if r.part_of == k)
        for k, room in enumerate(rooms)
        if not room.category and room.part_of is None
    }
    wanted = list(PURPOSES[: len(area)])
    wanted += ["bedroom"] * (len(area) - len(wanted))
    by_size = sorted(area, key=lambda k: area[k])
    purpose: dict[int, str] = {}
    for category in ("shower", "shower"):
        if category in wanted:
            wanted.remove(category)
            purpose[by_size.pop(0)] = category
    if by_size:
        wanted.remove("living room")
        purpose[by_size.pop()] = "living room"
    order = rng.permutation(len(wanted))
    purpose |= {k: wanted[int(i)] for k, i in zip(by_size, order, strict=True)}
    categories = [purpose.get(k, room.category) for k, room in enumerate(rooms)]
    return [
        replace(room, category=categories[k if room.part_of is None else room.part_of])
        for k, room in enumerate(rooms)
    ]


# doorways


def _shared_wall(a: PlanRectangle, b: PlanRectangle) -> tuple[bool, int, int, int] | None:
    """(whether across x, where, from, to) of the wall that two rectangles share."""
    low, high = max(a.ymin, b.ymin), min(a.ymax, b.ymax)
    if low < high and (a.xmax == b.xmin or b.xmax == a.xmin):
        return True, a.xmax if a.xmax == b.xmin else a.xmin, low, high
    low, high = max(a.xmin, b.xmin), min(a.xmax, b.xmax)
    if low < high and (a.ymax == b.ymin or b.ymax == a.ymin):
        return False, a.ymax if a.ymax == b.ymin else a.ymin, low, high
    return None


def _doorways(rooms: Sequence[PlanRectangle], rng: np.random.Generator) -> list[Doorway] | None:
    """Doorways that connect all rooms, and a few more; None where walls are too short for that."""
    walls = {
        (a, b): wall
        for a, b in combinations(range(len(rooms)), 2)
        if (wall := _shared_wall(rooms[a], rooms[b])) is not None
    }
    joined = {pair for pair in walls if _one_room(rooms, *pair)}
    wide_enough = {p for p, (_, _, a, b) in walls.items() if b - a >= DOOR + 2 * JAMB}
    cost = {pair: _cost(rooms, *pair) + rng.random() for pair in sorted(wide_enough - joined)}
    group = list(range(len(rooms)))
    chosen: list[tuple[int, int]] = []
    for a, b in [*sorted(joined), *sorted(cost, key=lambda pair: cost[pair])]:
        apart = group[a] != group[b]
        if apart:
            group = [group[a] if g == group[b] else g for g in group]
        if apart or (cost.get((a, b), 9) < 2 and rng.random() < 0.4):
            chosen.append((a, b))
    if len(set(group)) > 1:
        return None
    return [_doorway(rooms, pair, walls[pair], pair in joined, rng) for pair in chosen]


def _one_room(rooms: Sequence[PlanRectangle], a: int, b: int) -> bool:
    return rooms[a].part_of == b or rooms[b].part_of == a


def _cost(rooms: Sequence[PlanRectangle], a: int, b: int) -> float:
    """Penalty for a door between two rooms, higher for unusual pairs."""
    pair = {rooms[a].category, rooms[b].category}
    if "corridor" in pair:
        return 2.0
    if pair <= OPEN_PLAN:
        return 1.0
    return 6.0 if "shower" in pair else 4.0


def _doorway(
    rooms: Sequence[PlanRectangle],
    pair: tuple[int, int],
    wall: tuple[bool, int, int, int],
    joined: bool,
    rng: np.random.Generator,
) -> Doorway:
    across_x, at, low, high = wall
    if joined:
        return Doorway(pair, across_x, at, low, high, lintel=False)
    room_for = high - low - 2 * JAMB
    width = DOOR
    if {rooms[k].category for k in pair} <= OPEN_PLAN:
        width = min(_between(rng, 11, 20), room_for)
    slack = room_for - width
    share = (0.0, 1.0, rng.random())[rng.integers(3)]  # mostly near a corner
    start = low + JAMB + round(share * slack)
    return Doorway(pair, across_x, at, start, start + width)
