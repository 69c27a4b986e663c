"""Rooms of a mapped floor: the distance transform flooded from its peaks, and their outlines.

After the distance-transform and Voronoi methods of Bormann et al. ("Room segmentation: survey,
implementation, and analysis", ICRA 2016): every peak of the distance to the nearest wall starts a
basin; two basins meet at a passage, whose half width is the distance there. The passage is a door
where it is narrow beside both basins; else the basins are one room. Furniture that a camera looks
over is floor here, so tables do not cut rooms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area, area_of
from kg.model.records import FREE, LOW, TALL, UNKNOWN
from mapping.occupancy.mapped_floor import MappedFloor
from perception.binary_masks import connected_components, distance_to_walls, runs

_MIN_HOLE: Final = 0.5  # [m^2] smaller ones are part of the room
_STEP: Final = 0.01  # [m] to which corners are rounded


def room_areas(
    rooms: NDArray[np.int32],
    origin: NDArray[np.float64],
    cell: float,
    *,
    reach: float,
    noise: float,
) -> tuple[Area, ...]:
    """The area [m] of each of `rooms` (nx, ny), numbered from 0, -1 for none.

    Rooms reach up to `reach` [m] beyond their cells, or to the next room, into walls and the
    furniture along them. Outlines deviate by up to `noise` [m] from the cells.
    """
    steps = round(reach / cell)
    grown = np.pad(rooms, steps, constant_values=-1)
    for _ in range(steps):
        grown = _grown(grown)
    corner = origin - steps * cell
    return tuple(_area(grown == k, corner, cell, noise) for k in range(int(rooms.max()) + 1))


def _grown(rooms: NDArray[np.int32]) -> NDArray[np.int32]:
    """Each cell of no room given to the room of a neighbour, the lowest number of several."""
    none = np.iinfo(np.int32).max
    beside = np.pad(np.where(rooms < 0, none, rooms), 1, constant_values=none)
    for axis in (0, 1):  # over squares of three by three, so that corners stay corners
        along = np.moveaxis(beside, axis, 0)
        along = np.minimum.reduce([along[:-2], along[1:-1], along[2:]])
        beside = np.moveaxis(along, 0, axis)
    return np.where((rooms < 0) & (beside != none), beside, rooms).astype(np.int32)


def _area(mask: NDArray[np.bool_], corner: NDArray[np.float64], cell: float, noise: float) -> Area:
    """The largest part of `mask` (nx, ny), whose corner is at `corner` (2,) [m]."""
    import shapely

    parts = connected_components(mask)
    largest = parts == np.argmax(np.bincount(parts[mask]))
    x, a, b = runs(largest).T
    whole = shapely.union_all(shapely.box(x, a, x + 1, b))
    holes = [r for r in whole.interiors if shapely.Polygon(r).area * cell**2 >= _MIN_HOLE]
    # a ring keeps its first corner: the normal form begins with an extreme one
    whole = shapely.Polygon(whole.exterior, holes).normalize().simplify(noise / cell)
    rounded = shapely.set_precision(shapely.transform(whole, lambda at: corner + at * cell), _STEP)
    outline = max(shapely.get_parts(rounded), key=lambda part: part.area)
    return area_of([ring.coords for ring in (outline.exterior, *outline.interiors)])


NO_ROOM: Final = -1
_MAX_DISTANCE: Final = 1.6  # [m] larger distances count as this one: a door is never that wide


@dataclass(frozen=True, slots=True)
class SegmentationSettings:
    """Settings of the segmentation, fit on simulated houses (lab/research/measurements.md)."""

    cell: float = 0.1  # [m] side of a cell of the segmentation
    widest: float = 2.1  # [m] a wider passage is no door
    narrowing: float = 0.75  # a door's width is at most this share of that of the smaller basin
    least: float = 1.5  # [m^2] smaller parts belong to the neighbour they open to most
    hole: float = 4.0  # [m^2] unseen floor that is enclosed, up to this size, is floor
    pillar: float = 0.6  # [m] tall parts up to this length are furniture, not walls
    gap: float = 0.5  # [m] unseen floor this near to seen floor is no wall
    walls: float = 0.3  # [m] rooms reach this far into walls and the furniture along them
    noise: float = 0.15  # [m] tolerance of the simplification of their outlines


@dataclass(frozen=True, slots=True)
class Door:
    """A passage between two rooms."""

    rooms: tuple[int, int]  # numbers of the rooms, the lower first
    p_map: tuple[float, float]  # [m] its middle
    width: float  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """Rooms of a floor, and the doors between them."""

    origin: NDArray[np.float64]  # (2,) [m] corner of cell (0, 0)
    cell: float  # [m]
    rooms: NDArray[np.int32]  # (nx, ny) number of the room, or NO_ROOM
    doors: tuple[Door, ...]
    areas: tuple[Area, ...] = ()  # of the rooms [m], with the walls around them

    def __len__(self) -> int:
        return int(self.rooms.max(initial=NO_ROOM)) + 1


def segmented(floor: MappedFloor, settings: SegmentationSettings | None = None) -> Segmentation:
    """Rooms of a mapped floor, numbered from 0, the largest first."""
    s = settings or SegmentationSettings()
    resolution, origin = floor.resolution, floor.origin
    factor = max(1, round(s.cell / resolution))
    cell = factor * resolution
    states = _without_pillars(floor.states, s.pillar / resolution)
    inside = _floor(states, s.hole / resolution**2)
    assumed = inside | _gaps(states, inside, round(s.gap / resolution))
    distance = distance_to_walls(assumed, round(_MAX_DISTANCE / resolution)) * resolution
    pooled = _pooled(distance, factor)
    basins = np.where(
        _pooled(inside.astype(np.float64), factor) > 0, _Flood(pooled, s).run(), NO_ROOM
    )
    rooms = _without_small(basins, s.least / cell**2)
    doors = tuple(_doors(rooms, pooled, origin, cell))
    areas = room_areas(rooms, origin, cell, reach=s.walls, noise=s.noise)
    return Segmentation(origin, cell, rooms, doors, areas)


def _without_pillars(states: NDArray[np.uint8], max_length: float) -> NDArray[np.uint8]:
    """`states` in which tall parts of up to `max_length` cells count as low."""
    parts = connected_components(states == TALL)
    at = np.argwhere(parts >= 0)
    if not len(at):
        return states
    number = parts[tuple(at.T)]
    size = np.zeros(int(number.max()) + 1)
    for axis in (0, 1):
        low = np.full(len(size), np.inf)
        high = np.full(len(size), -np.inf)
        np.minimum.at(low, number, at[:, axis])
        np.maximum.at(high, number, at[:, axis] + 1)
        size = np.maximum(size, high - low)
    small = np.append(size <= max_length, False)[parts]
    return np.where(small, np.uint8(LOW), states)


def _floor(states: NDArray[np.uint8], hole: float) -> NDArray[np.bool_]:
    """Cells inside of rooms: free floor, low furniture, and small enclosed holes."""
    inside = (states == FREE) | (states == LOW)
    unknown = states == UNKNOWN
    parts = connected_components(unknown)
    sizes = np.bincount(parts[unknown], minlength=1)
    small = unknown & (sizes[parts] <= hole)
    return np.asarray(inside | small)


def _gaps(states: NDArray[np.uint8], inside: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Unknown cells up to `reach` cells from floor; as walls they would look like doors."""
    if reach <= 0:
        return np.zeros_like(inside)
    near = distance_to_walls(~np.pad(inside, reach + 1), reach + 1)[
        reach + 1 : -reach - 1, reach + 1 : -reach - 1
    ]
    return np.asarray((states == UNKNOWN) & (near <= reach))


def _pooled(distance: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    nx, ny = (-(-n // factor) for n in distance.shape)
    full = np.zeros((nx * factor, ny * factor))
    full[: distance.shape[0], : distance.shape[1]] = distance
    return np.asarray(full.reshape(nx, factor, ny, factor).max(axis=(1, 3)))


class _Flood:
    """Watershed of the distance transform, from its peaks down, with merging as basins meet."""

    def __init__(self, distance: NDArray[np.float64], settings: SegmentationSettings) -> None:
        self._distance, self._s = distance, settings
        self._parent: list[int] = []
        self._peak: list[float] = []  # [m] by basin
        self._apart: list[set[int]] = []  # basins behind a door, by basin

    def run(self) -> NDArray[np.int64]:
        """(nx, ny) the basin of each cell, or NO_ROOM."""
        padded = np.pad(self._distance, 1)
        width = padded.shape[1]
        depth = padded.ravel().tolist()
        order = np.argsort(-padded.ravel(), kind="stable")[: int((padded > 0).sum())].tolist()
        label = [NO_ROOM] * len(depth)
        steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
        for at in order:
            above = [at + step for step in steps if label[at + step] >= 0]
            around = {self._root(label[beside]) for beside in above}
            self._meet(around, depth[at])
            # uphill, so that no basin runs along the walls of another
            label[at] = label[max(above, key=depth.__getitem__)] if above else self._new(depth[at])
        roots = np.array([*(self._root(k) for k in range(len(self._parent))), NO_ROOM])
        return np.asarray(roots[np.array(label)].reshape(padded.shape)[1:-1, 1:-1])

    def _new(self, peak: float) -> int:
        self._parent.append(len(self._parent))
        self._peak.append(peak)
        self._apart.append(set())
        return len(self._parent) - 1

    def _meet(self, around: set[int], here: float) -> None:
        """Basins that meet in a cell at distance `here` are joined, or stay apart by a door."""
        if len(around) < 2:
            return
        first, *others = sorted(around, key=lambda k: (-self._peak[k], k))
        for other in others:
            if other in self._apart[first]:
                continue
            if self._is_door(self._peak[other], here):
                self._apart[first].add(other)
                self._apart[other].add(first)
            else:
                self._join(first, other)

    def _is_door(self, peak: float, here: float) -> bool:
        s = self._s
        return 2 * here <= s.widest and here <= s.narrowing * peak

    def _join(self, high: int, low: int) -> None:
        self._parent[low] = high
        for other in self._apart[low]:
            self._apart[other].discard(low)
            self._apart[other].add(high)
        self._apart[high] |= self._apart[low]

    def _root(self, k: int) -> int:
        while self._parent[k] != k:
            self._parent[k] = self._parent[self._parent[k]]
            k = self._parent[k]
        return k


def _without_small(labels: NDArray[np.int64], min_size: float) -> NDArray[np.int32]:
    """Rooms numbered by size; those under `min_size` cells joined to a neighbour, or dropped."""
    labels = labels.copy()
    while True:
        sizes = np.bincount(labels[labels >= 0], minlength=1)
        small = np.flatnonzero((sizes > 0) & (sizes < min_size))
        if not len(small):
            break
        part = int(small[np.argmin(sizes[small])])
        beside = _neighbours(labels, part)
        labels[labels == part] = np.argmax(np.bincount(beside)) if len(beside) else NO_ROOM
    order = np.argsort(-sizes, kind="stable")[: int((sizes > 0).sum())]
    number = np.full(len(sizes) + 1, NO_ROOM, np.int32)
    number[order] = np.arange(len(order))
    return np.asarray(number[labels], np.int32)


def _neighbours(labels: NDArray[np.int64], part: int) -> NDArray[np.int64]:
    """Rooms of the cells that touch `part`, one entry for each side."""
    found = []
    for axis in (0, 1):
        one, other = np.moveaxis(labels, axis, 0)[:-1], np.moveaxis(labels, axis, 0)[1:]
        found += [other[one == part], one[other == part]]
    beside = np.concatenate(found)
    return np.asarray(beside[(beside >= 0) & (beside != part)])


def _doors(
    rooms: NDArray[np.int32],
    distance: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
) -> Iterator[Door]:
    """Doors: one for each stretch along which two rooms touch, at its widest point."""
    touching: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for dx, dy in ((1, 0), (0, 1)):
        one, other = rooms[: rooms.shape[0] - dx, : rooms.shape[1] - dy], rooms[dx:, dy:]
        for x, y in np.argwhere((one != other) & (one >= 0) & (other >= 0)).tolist():
            a, b = int(one[x, y]), int(other[x, y])
            touching.setdefault((min(a, b), max(a, b)), set()).update(((x, y), (x + dx, y + dy)))
    for pair, cells in sorted(touching.items()):
        mask = np.zeros(rooms.shape, np.bool_)
        mask[tuple(np.array(sorted(cells)).T)] = True
        parts = connected_components(mask)
        for part in range(int(parts.max()) + 1):
            at = np.argwhere(parts == part)
            widest = at[int(np.argmax(distance[tuple(at.T)]))]
            width = 2 * float(distance[tuple(widest)])
            x, y = origin + (widest + 0.5) * cell
            yield Door(pair, (float(x), float(y)), width)
