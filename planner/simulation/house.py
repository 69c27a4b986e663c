"""Houses as data: rooms, walls with doorways, furniture of simple shapes, and the free floor.

Map frame: x east, y north, z up, metres, the floor at z = 0. Nothing here is random;
`lab.houses.random_house` draws houses.
"""

from __future__ import annotations

import colorsys
import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from planner.freespace.geodesic import distance_fields, shortest_path
from planner.freespace.grid import NO_ROOM, FreeSpace

Shape = Literal["box", "cylinder", "ellipsoid"]
Surface = Literal["opaque", "screen", "glass"]
Facing = Literal["north", "west", "south", "east"]
RGB = tuple[float, float, float]

_FILE: Final = Path(__file__).with_name("furniture.csv")

FACINGS: Final[tuple[Facing, ...]] = ("north", "west", "south", "east")
QUARTER_TURNS: Final[Mapping[Facing, int]] = {facing: k for k, facing in enumerate(FACINGS)}


def turned(x: float, y: float, facing: Facing) -> tuple[float, float]:
    """(x, y) of a thing that faces north, turned with it to `facing`."""
    return ((x, y), (-y, x), (-x, -y), (y, -x))[QUARTER_TURNS[facing]]


@dataclass(frozen=True, slots=True)
class Solid:
    """An axis-aligned box, or the upright elliptic cylinder or ellipsoid that fills it."""

    shape: Shape
    lo: NDArray[np.float64]  # (3,) [m] map frame
    hi: NDArray[np.float64]  # (3,) [m]
    colour: RGB  # 0..1
    depth_return: bool = True  # False: a depth camera gets nothing back (lit screens, glass)


@dataclass(frozen=True, slots=True)
class SolidPart:
    """One solid of a thing, in the thing's own coordinates."""

    x: float  # centre [m]
    y: float
    z: float  # underside [m]
    width: float  # along x [m]
    depth: float  # along y
    height: float
    colour: RGB
    shape: Shape = "box"
    surface: Surface = "opaque"

    def scaled(self, scale: tuple[float, float, float]) -> SolidPart:
        """The part of a thing that is `scale` times as wide, deep and high."""
        sx, sy, sz = scale
        return replace(
            self,
            x=self.x * sx,
            y=self.y * sy,
            z=self.z * sz,
            width=self.width * sx,
            depth=self.depth * sy,
            height=self.height * sz,
        )

    def placed(self, at: tuple[float, float, float], facing: Facing) -> Solid:
        """The part as a solid of the house, its front turned to `facing`."""
        half = np.array([self.width, self.depth]) / 2
        half = half[::-1] if QUARTER_TURNS[facing] % 2 else half
        centre = np.array(at[:2]) + turned(self.x, self.y, facing)
        lo = np.append(centre - half, at[2] + self.z)
        hi = np.append(centre + half, at[2] + self.z + self.height)
        return Solid(self.shape, lo, hi, self.colour)


def _shapes(kind: str) -> Mapping[str, tuple[SolidPart, ...]]:
    """The parts of each class of that kind, by its label, in the order of the file."""
    shapes = dict[str, tuple[SolidPart, ...]]()
    with _FILE.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["kind"] == kind:
                shapes[row["label"]] = (*shapes.get(row["label"], ()), _part(row))
    return shapes


def _part(row: Mapping[str, str]) -> SolidPart:
    red, green, blue = map(float, row["colour"].split())
    return SolidPart(
        x=float(row["x"]),
        y=float(row["y"]),
        z=float(row["z"]),
        width=float(row["width"]),
        depth=float(row["depth"]),
        height=float(row["height"]),
        colour=(red, green, blue),
        shape=cast("Shape", row["shape"]),
        surface=cast("Surface", row["surface"]),
    )


#: COCO classes the house can hold.
OBJECTS: Final = _shapes("object")

#: Furnishings no detector of COCO classes names. They hide things and carry them.
FURNISHINGS: Final = _shapes("furnishing")


#: items of the demo's house
_ITEMS: Final = Path(__file__).with_name("furnished_house.csv")
WALL_HEIGHT = 2.5  # [m]
WALL_THICKNESS = 0.10  # [m]
DOOR_HEIGHT = 2.05  # [m]
WALL_COLOUR: RGB = (0.93, 0.91, 0.86)


@dataclass(frozen=True, slots=True)
class HouseRoom:
    """One room: the rectangle between its walls' centre lines."""

    name: str
    category: str  # label of its place category
    xmin: float  # [m]
    xmax: float
    ymin: float
    ymax: float
    floor: str  # "planks" or "tiles"
    floor_colour: RGB
    viewpoints: tuple[tuple[float, float], ...]  # positions at which a tour looks around [m]
    part_of: str = ""  # name of the other rectangle of an L-shaped room

    @property
    def centre(self) -> NDArray[np.float64]:
        """(2,) [m] the middle of the rectangle."""
        return np.array([(self.xmin + self.xmax) / 2, (self.ymin + self.ymax) / 2])

    def contains(self, x: float, y: float) -> bool:
        """Whether a point [m] lies in the room."""
        return self.xmin <= x < self.xmax and self.ymin <= y < self.ymax


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight wall along x or y, with the doorways that interrupt it."""

    start: tuple[float, float]  # [m]
    end: tuple[float, float]
    doors: tuple[tuple[float, float], ...] = ()  # (from, to) along the wall's axis [m]

    @property
    def along_x(self) -> bool:
        """Whether the wall runs east to west."""
        return self.start[1] == self.end[1]

    def pieces(self) -> list[tuple[float, float]]:
        """(from, to) of the stretches of wall between the doorways [m]."""
        axis = 0 if self.along_x else 1
        edges = [self.start[axis], *(e for door in self.doors for e in door), self.end[axis]]
        return list(zip(edges[::2], edges[1::2], strict=True))

    def solids(self) -> list[Solid]:
        """The wall and the lintels over its doorways."""
        half = WALL_THICKNESS / 2
        stretches = [(a - half, b + half, 0.0) for a, b in self.pieces()]
        stretches += [(a, b, DOOR_HEIGHT) for a, b in self.doors]
        axis = 0 if self.along_x else 1
        solids = []
        for a, b, bottom in stretches:
            lo = np.array([*np.subtract(self.start, half), bottom])
            hi = np.array([*np.add(self.start, half), WALL_HEIGHT])
            lo[axis], hi[axis] = a, b
            solids.append(Solid("box", lo, hi, WALL_COLOUR))
        return solids


@dataclass(frozen=True, slots=True)
class Item:
    """An item of the house, of a class of `furniture`, with position and orientation."""

    label: str
    x: float  # middle of its footprint [m]
    y: float
    z: float = 0.0  # height of its underside [m]
    facing: Facing = "north"
    name: str = ""  # identity, unique in the house; "" without one
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of width, depth and height
    hue: float = 0.0  # turn of its colours on the colour circle, 0..1
    tone: float = 1.0  # brightness of its colours, as a share
    lit: bool = False  # whether its screen is on and returns no depth

    @property
    def parts(self) -> tuple[SolidPart, ...]:
        """Its solids in its own coordinates."""
        parts = OBJECTS[self.label] if self.label in OBJECTS else FURNISHINGS[self.label]
        return parts if self.scale == (1, 1, 1) else tuple(p.scaled(self.scale) for p in parts)

    def solids(self) -> list[Solid]:
        """Its solids in the map frame."""
        at = (self.x, self.y, self.z)
        return [self._finished(part.placed(at, self.facing), part) for part in self.parts]

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner (3,) [m] of its bounding box in the map frame."""
        solids = self.solids()
        return np.min([s.lo for s in solids], axis=0), np.max([s.hi for s in solids], axis=0)

    def centre(self) -> NDArray[np.float64]:
        """(3,) [m] geometrical centre in the map frame: the middle of its bounding box."""
        lo, hi = self.bounds()
        return np.asarray((lo + hi) / 2, dtype=np.float64)

    def _finished(self, solid: Solid, part: SolidPart) -> Solid:
        """`solid` in the colours of this item, with its surface's return of depth."""
        no_return = part.surface == "glass" or (part.surface == "screen" and self.lit)
        if not no_return and self.hue == 0 and self.tone == 1:
            return solid
        hue, saturation, value = colorsys.rgb_to_hsv(*solid.colour)
        colour = colorsys.hsv_to_rgb(hue + self.hue, saturation, min(1.0, value * self.tone))
        return replace(solid, colour=colour, depth_return=not no_return)


@dataclass(frozen=True, slots=True)
class House:
    """Rooms, walls and items; a detector can name the `objects`, which are in a fixed order."""

    rooms: tuple[HouseRoom, ...]
    walls: tuple[Wall, ...]
    objects: tuple[Item, ...]
    furnishings: tuple[Item, ...] = field(default=())

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(xmin, xmax, ymin, ymax) of all rooms [m]."""
        return (
            min(r.xmin for r in self.rooms),
            max(r.xmax for r in self.rooms),
            min(r.ymin for r in self.rooms),
            max(r.ymax for r in self.rooms),
        )

    def room_at(self, x: float, y: float) -> HouseRoom | None:
        """The room a point [m] lies in."""
        return next((room for room in self.rooms if room.contains(x, y)), None)

    def with_objects(self, items: Iterable[Item]) -> House:
        """The same house with `items` added; the numbers of the other objects stay."""
        return replace(self, objects=(*self.objects, *items))


def furnished_house() -> House:
    """The demo's house: 11.4 m x 9.2 m, seven rooms, 54 objects of COCO classes."""
    items: dict[str, list[Item]] = {"object": [], "furnishing": []}
    with _ITEMS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            x, y, z = (float(row[axis]) for axis in "xyz")
            facing = cast("Facing", row["facing"])
            items[row["kind"]].append(Item(row["label"], x, y, z, facing))
    return House(ROOMS, WALLS, tuple(items["object"]), tuple(items["furnishing"]))


OAK: RGB = (0.76, 0.58, 0.40)
WALNUT: RGB = (0.60, 0.44, 0.32)
SLATE: RGB = (0.66, 0.68, 0.69)
CHALK: RGB = (0.86, 0.87, 0.86)

# in the order a tour visits them
ROOMS = (
    HouseRoom("corridor", "corridor", 0, 11.4, 4, 5.4, "planks", OAK, ((2.6, 4.7), (8.4, 4.7))),
    HouseRoom(
        "bedroom", "bedroom", 7.4, 11.4, 5.4, 9.2, "planks", WALNUT, ((9.2, 6.3), (8.3, 7.2))
    ),
    HouseRoom("bathroom", "shower", 8.6, 11.4, 0, 4, "tiles", CHALK, ((10.0, 2.4),)),
    HouseRoom("home office", "home office", 5, 8.6, 0, 4, "planks", WALNUT, ((6.7, 2.4),)),
    HouseRoom(
        "dining room", "dining room", 4, 7.4, 5.4, 9.2, "planks", OAK, ((5.7, 6.1), (4.7, 8.2))
    ),
    HouseRoom("kitchen", "kitchen", 0, 4, 5.4, 9.2, "tiles", SLATE, ((1.9, 6.7), (2.9, 7.6))),
    HouseRoom("living room", "living room", 0, 5, 0, 4, "planks", OAK, ((2.3, 3.0), (3.2, 0.75))),
)

WALLS = (
    Wall((0, 0), (11.4, 0)),
    Wall((0, 9.2), (11.4, 9.2)),
    Wall((0, 0), (0, 9.2)),
    Wall((11.4, 0), (11.4, 9.2)),
    Wall((0, 4), (11.4, 4), doors=((2.1, 3.2), (6.3, 7.2), (9.5, 10.4))),
    Wall((0, 5.4), (11.4, 5.4), doors=((1.5, 2.4), (5.2, 6.1), (8.9, 9.8))),
    Wall((5, 0), (5, 4)),
    Wall((8.6, 0), (8.6, 4)),
    Wall((4, 5.4), (4, 9.2), doors=((6.5, 7.7),)),
    Wall((7.4, 5.4), (7.4, 9.2)),
)


CELL = 0.10  # [m]
ROBOT_RADIUS = 0.24  # [m]
ROBOT_HEIGHT = 1.30  # [m] solids above do not stop the robot
STEP_HEIGHT = 0.02  # [m] the robot drives over lower solids


class FloorGrid:
    """Occupancy grid of a house, inflated by the robot's radius."""

    def __init__(self, house: House) -> None:
        xmin, xmax, ymin, ymax = house.extent
        self._origin = np.array([xmin, ymin])
        columns, rows = round((xmax - xmin) / CELL), round((ymax - ymin) / CELL)
        x, y = xmin + (np.arange(columns) + 0.5) * CELL, ymin + (np.arange(rows) + 0.5) * CELL
        self.clearance = np.full((columns, rows), np.inf)  # (x, y) [m] to the nearest obstacle
        items = [s for item in (*house.objects, *house.furnishings) for s in item.solids()]
        for solid in [*items, *(s for wall in house.walls for s in wall.solids())]:
            if solid.lo[2] > ROBOT_HEIGHT or solid.hi[2] < STEP_HEIGHT:
                continue
            dx = np.maximum(np.maximum(solid.lo[0] - x, x - solid.hi[0]), 0)
            dy = np.maximum(np.maximum(solid.lo[1] - y, y - solid.hi[1]), 0)
            np.minimum(self.clearance, np.hypot(dx[:, None], dy[None, :]), out=self.clearance)
        self.free = self.clearance > ROBOT_RADIUS  # (x, y)

    def path(self, start: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) [m] corners of the shortest path from `start` to the free floor nearest to `goal`.

        Raises LayoutError where no free floor is reachable.
        """
        space = self._space()
        source = space.nearest(start)
        reached = np.flatnonzero(space.reachable(source))
        away = np.linalg.norm(space.centres(reached) - goal, axis=1)
        field = distance_fields(space, [int(reached[np.argmin(away)])])[0]
        cells = shortest_path(space, field, source)
        corners = space.centres(self._straightened([divmod(int(c), space.shape[1]) for c in cells]))
        return np.array([np.asarray(start, np.float64), *corners[1:]])

    def reachable(self, start: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(x, y) whether the robot can drive to each cell from the floor nearest to `start` [m]."""
        space = self._space()
        return space.reachable(space.nearest(start)).reshape(self.free.shape)

    def centres(self, cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(n, 2) [m] centres of the marked cells (x, y)."""
        return np.asarray(self._origin + (np.argwhere(cells) + 0.5) * CELL, np.float64)

    def _space(self) -> FreeSpace:
        return FreeSpace(self._origin, CELL, np.where(self.free, 0, NO_ROOM).astype(np.int32))

    def _straightened(self, cells: list[tuple[int, int]]) -> NDArray[np.intp]:
        """Numbers (n,) of the cells of `cells` (ix, iy) that no free straight line skips."""
        kept, k = [cells[0]], 0
        while k < len(cells) - 1:
            reach = len(cells) - 1
            while reach > k + 1 and not self._clear(cells[k], cells[reach]):
                reach -= 1
            k = reach
            kept.append(cells[k])
        return np.array([i * self.free.shape[1] + j for i, j in kept], np.intp)

    def _clear(self, a: tuple[int, int], b: tuple[int, int]) -> bool:
        n = 3 * max(abs(a[0] - b[0]), abs(a[1] - b[1]), 1)
        line = np.rint(np.linspace(a, b, n + 1)).astype(int)
        return bool(self.free[line[:, 0], line[:, 1]].all())
