"""Placement of furniture in a room that keeps the way between its doors free."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.houses.furniture_groups import Group, GroupChoice, Where
from planner.simulation.house import (
    CELL,
    FACINGS,
    OBJECTS,
    ROBOT_HEIGHT,
    WALL_THICKNESS,
    Facing,
    FloorGrid,
    House,
    HouseRoom,
    Item,
    Wall,
)

TRIES: Final = 24  # random spots tried before a group stays out
DOOR_ZONE: Final = 0.75  # [m] floor kept free before a doorway
MARGIN: Final = 0.03  # [m] between neighbours
CLEARANCE: Final = 0.5  # [m] around a viewpoint, if the room has as much
WELL_SEEN: Final = (0.9, 2.6)  # [m] from a viewpoint to the small things that it is for
FAR_APART: Final = 1.0  # [m] between viewpoints of one room, at least
VIEWS: Final = 2  # viewpoints wanted for each small thing
MAX_VIEWPOINTS: Final = 4

_Box = tuple[NDArray[np.float64], NDArray[np.float64]]  # lower and upper corner (3,) [m]


class RoomFurnisher:
    """The furniture of one room."""

    def __init__(
        self,
        room: HouseRoom,
        walls: Sequence[Wall],
        rooms: Sequence[HouseRoom],
        items: Iterable[Item] = (),
    ) -> None:
        self.room = room
        self.items = list(items)
        self._walls = tuple(walls)
        self._rooms = rooms
        self._doors = _doors_of(room, walls) + _open_sides(room, rooms)
        self._zones = [_zone(door, room) for door in self._doors]
        self._boxes = [item.bounds() for item in self.items if item.label != "rug"]

    def place_choice(self, choice: GroupChoice, rng: np.random.Generator) -> None:
        """Place the group of `choice`; if it does not fit, its alternative."""
        if not self.place(choice.make(rng), choice.where, rng) and choice.otherwise is not None:
            self.place(choice.otherwise(rng), "wall", rng)

    def place(self, group: Group, where: Where, rng: np.random.Generator) -> tuple[Item, ...]:
        """Place `group` at a random free spot; returns its items, () without a free spot."""
        for _ in range(TRIES):
            facing = FACINGS[rng.integers(4)]
            if where == "outer wall" and not self._is_outer(facing):
                continue
            items = self._spot(group, facing, where, rng)
            boxes = [item.bounds() for item in items if item.label != "rug"]
            if not self._fits(items, boxes):
                continue
            self.items += items
            if min(box[0][2] for box in boxes) < ROBOT_HEIGHT and not self._passable():
                del self.items[-len(items) :]
                continue
            self._boxes += boxes
            return items
        return ()

    def viewpoints(self, targets: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
        """One to four viewpoints [m] in the room that are near most of `targets` (n, 2) [m].

        Each next viewpoint has the most targets of the room within `WELL_SEEN`. A target that has
        VIEWS viewpoints no longer counts.
        """
        grid = self._grid()
        clearance = np.where(grid.reachable(self._door_points()[0]), grid.clearance, 0)
        standing = grid.centres(clearance > min(CLEARANCE, 0.8 * clearance.max()))
        inside = np.array([self.room.contains(x, y) for x, y in targets], np.bool_)
        away = np.linalg.norm(standing[:, None] - targets[inside][None], axis=2)
        near = (away > WELL_SEEN[0]) & (away < WELL_SEEN[1])  # (places, targets)
        central = np.linalg.norm(standing - self.room.centre, axis=1)
        chosen, views = list[int](), np.zeros(near.shape[1], np.int64)
        while len(chosen) < MAX_VIEWPOINTS:
            gain = near[:, views < VIEWS].sum(axis=1)
            for other in chosen:
                gain[np.linalg.norm(standing - standing[other], axis=1) < FAR_APART] = 0
            if chosen and gain.max() == 0:
                break
            chosen.append(int(np.lexsort((central, -gain))[0]))
            views += near[chosen[-1]]
        return tuple((round(float(x), 3), round(float(y), 3)) for x, y in standing[chosen])

    def _spot(
        self, group: Group, facing: Facing, where: Where, rng: np.random.Generator
    ) -> tuple[Item, ...]:
        """The group at a random spot: against the wall behind it, or near the middle."""
        r, half = self.room, WALL_THICKNESS / 2
        boxes = [item.placed((0, 0), facing).bounds() for item in group if item.label != "rug"]
        lo = np.min([box[0] for box in boxes], axis=0)[:2]
        hi = np.max([box[1] for box in boxes], axis=0)[:2]
        low = np.array([r.xmin, r.ymin]) + half - lo
        high = np.array([r.xmax, r.ymax]) - half - hi
        if where == "centre":
            middle = self.room.centre - (lo + hi) / 2
            at = middle + rng.uniform(-0.35, 0.35, 2)
        else:
            at = low + rng.random(2) * np.maximum(high - low, 0)
            at += (rng.random(2) < 0.2) * (low - at)  # now and then right in the corner
            axis = 1 if facing in ("north", "south") else 0
            back = {"north": r.ymin + half, "south": r.ymax - half}
            back |= {"east": r.xmin + half, "west": r.xmax - half}
            at[axis] = back[facing]
        return tuple(item.placed((float(at[0]), float(at[1])), facing) for item in group)

    def _fits(self, items: Sequence[Item], boxes: Sequence[_Box]) -> bool:
        r, half = self.room, WALL_THICKNESS / 2 - 0.06  # windows and pictures reach into the wall
        for lo, hi in boxes:
            if lo[0] < r.xmin + half or hi[0] > r.xmax - half:
                return False
            if lo[1] < r.ymin + half or hi[1] > r.ymax - half:
                return False
            if any(_overlap((lo, hi), zone, 0.0) for zone in self._zones):
                return False
            if any(_overlap((lo, hi), other, MARGIN) for other in self._boxes):
                return False
        return True

    def _is_outer(self, facing: Facing) -> bool:
        """Whether the wall behind an item with that facing is an outer wall."""
        r = self.room
        middle = self.room.centre
        outside = {
            "north": (middle[0], r.ymin - 0.3),
            "south": (middle[0], r.ymax + 0.3),
            "east": (r.xmin - 0.3, middle[1]),
            "west": (r.xmax + 0.3, middle[1]),
        }[facing]
        return not any(room.contains(*outside) for room in self._rooms)

    def _passable(self) -> bool:
        """Whether all doors, and half of the floor between furniture, are reachable from a door.

        A room without a door is not.
        """
        grid, doors = self._grid(), self._door_points()
        if not doors:
            return False
        reached = grid.reachable(doors[0])
        cells = grid.centres(reached)
        near = [np.linalg.norm(cells - door, axis=1).min() < 3 * CELL for door in doors]
        return all(near) and bool(reached.sum() > 0.8 * grid.free.sum())

    def _grid(self) -> FloorGrid:
        objects = tuple(item for item in self.items if item.label in OBJECTS)
        others = tuple(item for item in self.items if item.label not in OBJECTS)
        return FloorGrid(House((self.room,), self._walls, objects, others))

    def _door_points(self) -> list[NDArray[np.float64]]:
        """(2,) [m] a step inside each doorway."""
        return [(zone[0] + zone[1])[:2] / 2 for zone in self._zones]


_Door = tuple[int, float, float, float]  # axis walked along, wall's coordinate, from, to [m]


def _doors_of(room: HouseRoom, walls: Sequence[Wall]) -> list[_Door]:
    doors = list[_Door]()
    for wall in walls:
        axis = 1 if wall.along_x else 0
        at = wall.start[axis]
        sides = (room.ymin, room.ymax) if wall.along_x else (room.xmin, room.xmax)
        ends = (room.xmin, room.xmax) if wall.along_x else (room.ymin, room.ymax)
        doors += [(axis, at, a, b) for a, b in wall.doors if at in sides and ends[0] <= a < ends[1]]
    return doors


def _open_sides(room: HouseRoom, rooms: Sequence[HouseRoom]) -> list[_Door]:
    """Open sides between the two parts of an L-shaped room."""
    doors = list[_Door]()
    for other in rooms:
        if other.name != room.part_of and other.part_of != room.name:
            continue
        for at in {room.xmin, room.xmax} & {other.xmin, other.xmax}:
            low, high = max(room.ymin, other.ymin), min(room.ymax, other.ymax)
            doors += [(0, at, low, high)] if low < high else []
        for at in {room.ymin, room.ymax} & {other.ymin, other.ymax}:
            low, high = max(room.xmin, other.xmin), min(room.xmax, other.xmax)
            doors += [(1, at, low, high)] if low < high else []
    return doors


def _zone(door: _Door, room: HouseRoom) -> _Box:
    """The floor before a doorway, inside the room."""
    axis, at, low, high = door
    inwards = 1 if at == (room.xmin, room.ymin)[axis] else -1
    ends = sorted((at, at + inwards * DOOR_ZONE))
    lo, hi = np.array([low, low, 0.0]), np.array([high, high, 2.0])
    lo[axis], hi[axis] = ends
    return lo, hi


def _overlap(a: _Box, b: _Box, margin: float) -> bool:
    return bool(np.all(a[0] < b[1] + margin) and np.all(a[1] > b[0] - margin))
