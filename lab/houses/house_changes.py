"""Changes of a house between two sessions: small things move, vanish, appear, or are carried."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.houses.furniture_groups import single
from lab.houses.random_house import new_thing
from lab.houses.room_furnisher import RoomFurnisher
from lab.houses.small_things import (
    FLOOR,
    MEAN_COUNT,
    MOVABLE,
    STANDS_ON,
    SupportSurface,
    SurfaceSampler,
)
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import FloorGrid, House, Item, Solid
from planner.simulation.house_robot import TimedPose

MOVED: Final = 0.20  # share of the small things that stand elsewhere in the next session
VANISHED: Final = 0.05  # share of the small things that are gone
NEW: Final = 0.05  # number of new things, as a share of the small things
CARRIED: Final = 0.06  # share of the small things that are carried during the session
TRIES: Final = 20  # to find space for new things
CARRY_HEIGHT: Final = 1.1  # [m]
IN_VIEW: Final = (0.8, 3.5)  # [m] from the camera to a thing that is picked up
PAUSE: Final = 10  # pictures that the standing robot takes while it watches
INTERVAL: Final = 0.5  # [s] between these pictures


@dataclass(frozen=True, slots=True)
class HouseChange:
    """A house in the next session; names are those of the items."""

    house: House
    moved: frozenset[str]  # carried ones too
    carried: frozenset[str]
    new: frozenset[str]
    vanished: tuple[Item, ...]


def changed_house(house: House, rng: np.random.Generator) -> HouseChange:
    """The same house later: some small things moved, mostly to other rooms."""
    small = [item for item in house.objects if item.label in MOVABLE]
    drawn = [small[int(i)] for i in rng.permutation(len(small))]
    share = [max(1, round(part * len(small))) for part in (MOVED, VANISHED, CARRIED)]
    on_furniture = [item for item in drawn if item.z > 0]
    carried = {item.name for item in on_furniture[: share[2]]}
    others = [item for item in drawn if item.name not in carried]
    moving = {item.name for item in others[: share[0]]}
    vanished = tuple(others[share[0] : share[0] + share[1]])
    gone = {item.name for item in vanished}
    objects = [item for item in house.objects if item.name not in gone]
    moved = set[str]()
    for k, item in enumerate(objects):
        if item.name in moving | carried:
            elsewhere = _elsewhere(item, replace(house, objects=tuple(objects)), rng)
            if elsewhere is not None:
                objects[k] = elsewhere
                moved.add(item.name)
    count = Counter(item.label for item in house.objects)
    new = list[str]()
    for _ in range(TRIES):
        added = _added(replace(house, objects=tuple(objects)), count, rng)
        if added is not None and len(new) < max(1, round(NEW * len(small))):
            objects.append(added)
            new.append(added.name)
    rooms = tuple(reversed(house.rooms))  # the robot drives the tour in reverse
    changed = replace(house, rooms=rooms, objects=tuple(objects))
    return HouseChange(
        changed, frozenset(moved), frozenset(carried & moved), frozenset(new), vanished
    )


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """An object that somebody carries during the session.

    Until `start` it stands at the first point of the path, afterwards it moves to the last one. The
    house describes it at the last one.
    """

    index: int  # into House.objects
    path: NDArray[np.float64]  # (n, 3) [m] of the point below it
    start: float  # [s]
    speed: float = 0.7  # [m/s]

    def offset(self, stamp: float) -> NDArray[np.float64]:
        """(3,) [m] from its last position to its position at `stamp` [s]."""
        along = (stamp - self.start) * self.speed
        steps = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        lengths = np.concatenate([[0.0], np.cumsum(steps)])
        at = [np.interp(along, lengths, self.path[:, axis]) for axis in range(3)]
        return np.asarray(np.array(at) - self.path[-1], np.float64)


class CarryingCamera(SimulatedCamera):
    """Renders a house in which things are carried."""

    def __init__(
        self, house: House, model: CameraModel, seed: int, carries: Sequence[Carry]
    ) -> None:
        super().__init__(house, model, seed)
        self._carries = tuple(carries)

    def _solids_at(self, stamp: float) -> list[Solid]:
        offsets = {carry.index: carry.offset(stamp) for carry in self._carries}
        solids = list(self._solids)
        for number, (solid, i) in enumerate(zip(solids, self._instance, strict=False)):
            if (offset := offsets.get(int(i))) is not None:
                solids[number] = replace(solid, lo=solid.lo + offset, hi=solid.hi + offset)
        return solids


def carries(
    before: House, change: HouseChange, poses: Sequence[TimedPose], model: CameraModel, start: float
) -> tuple[tuple[Carry, ...], tuple[TimedPose, ...]]:
    """Paths and times of the carried things, and the drive with pauses to watch them.

    Each thing is picked up when it is in view of the robot, which drives along `poses` from `start`
    [s] on; without such a pose, in the middle of the drive.
    """
    old = {item.name: item for item in before.objects}
    numbers = [k for k, item in enumerate(change.house.objects) if item.name in change.carried]
    origins = [old[change.house.objects[k].name] for k in numbers]
    when = [_when_seen(origin, poses, change.house, model) for origin in origins]
    drive = _with_pauses(poses, set(when))
    floor = FloorGrid(change.house)
    found = list[Carry]()
    for index, origin, number in zip(numbers, origins, when, strict=True):
        item = change.house.objects[index]
        pose = drive[number + PAUSE * sum(other < number for other in set(when))]
        first, last = np.array([origin.x, origin.y]), np.array([item.x, item.y])
        way = [(x, y, CARRY_HEIGHT) for x, y in [*floor.path(first, last), last]]
        path = [(origin.x, origin.y, origin.z), *way, (item.x, item.y, item.z)]
        found.append(Carry(index, np.array(path), start + pose.seconds))
    return tuple(found), drive


def _with_pauses(poses: Sequence[TimedPose], pauses: Collection[int]) -> tuple[TimedPose, ...]:
    """`poses` with PAUSE more pictures, INTERVAL apart, at the poses numbered `pauses`."""
    out, delay = list[TimedPose](), 0.0
    for number, pose in enumerate(poses):
        out.append(replace(pose, seconds=pose.seconds + delay))
        for _ in range(PAUSE if number in pauses else 0):
            delay += INTERVAL
            out.append(replace(pose, seconds=pose.seconds + delay))
    return tuple(out)


def _when_seen(item: Item, poses: Sequence[TimedPose], house: House, model: CameraModel) -> int:
    """Number of the middle one of the poses with `item` in view; without any, of all poses."""
    seen = [k for k, pose in enumerate(poses) if _is_in_view(item, pose, house, model)]
    return seen[len(seen) // 2] if seen else len(poses) // 2


def _is_in_view(item: Item, pose: TimedPose, house: House, model: CameraModel) -> bool:
    """Whether `item` is in the middle of the image at a pose in the same room."""
    x, y = item.x - pose.x, item.y - pose.y
    away = float(np.hypot(x, y))
    turned = abs((np.arctan2(y, x) - pose.heading + np.pi) % (2 * np.pi) - np.pi)
    room = house.room_at(item.x, item.y)
    return (
        IN_VIEW[0] < away < IN_VIEW[1]
        and turned < 0.35 * model.width / model.focal
        and room is not None
        and room.contains(pose.x, pose.y)
    )


def _elsewhere(item: Item, house: House, rng: np.random.Generator) -> Item | None:
    """`item` on suitable furniture of another room, else on other furniture of its room."""
    if STANDS_ON[item.label] == (FLOOR,):
        return _on_another_floor(item, house, rng)
    others = [o for o in house.objects if o.name != item.name]
    sampler = SurfaceSampler([*house.furnishings, *others])
    here = house.room_at(item.x, item.y)
    usual = [s for s in sampler.surfaces if s.label in STANDS_ON[item.label]]
    level = [s for s in sampler.surfaces if s.label != "bookcase"]

    def away(surfaces: list[SupportSurface]) -> list[SupportSurface]:
        return [s for s in surfaces if house.room_at(*((s.lo + s.hi) / 2)) != here]

    apart = [s for s in usual if np.any(s.lo > (item.x, item.y)) or np.any(s.hi < (item.x, item.y))]
    for surfaces in (away(usual), apart, away(level)):
        placed = sampler.place(item, surfaces, rng)
        if placed is not None:
            return placed
    return None


def _on_another_floor(item: Item, house: House, rng: np.random.Generator) -> Item | None:
    here = house.room_at(item.x, item.y)
    rooms = [room for room in house.rooms if room != here]
    for number in rng.permutation(len(rooms)):
        room = rooms[int(number)]
        inside = [i for i in (*house.objects, *house.furnishings) if room.contains(i.x, i.y)]
        furnisher = RoomFurnisher(room, house.walls, house.rooms, inside)
        placed = furnisher.place(single(item.label), "wall", rng)
        if placed:
            spot = placed[0]
            return replace(item, x=spot.x, y=spot.y, z=spot.z, facing=spot.facing)
    return None


def _added(house: House, count: Counter[str], rng: np.random.Generator) -> Item | None:
    """A new small thing with a new name; it is counted in `count`."""
    room = house.rooms[rng.integers(len(house.rooms))]
    usual = [
        label
        for label in MEAN_COUNT[room.category]
        if label in MOVABLE and STANDS_ON[label] != (FLOOR,)
    ]
    label = usual[rng.integers(len(usual))]
    sampler = SurfaceSampler([*house.furnishings, *house.objects])
    surfaces = [s for s in sampler.surfaces if s.label in STANDS_ON[label]]
    placed = sampler.place(new_thing(label, rng), surfaces, rng)
    if placed is None:
        return None
    count[label] += 1
    return replace(placed, name=f"{label.replace(' ', '_')}_{count[label]}")
