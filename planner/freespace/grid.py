"""Free space as a grid: floor cells, the room of each, and passages; also from an occupancy grid.

A grid is made of rooms (rectangles or polygons). A wall of one cell separates two rooms that touch;
a door is an opening cut through it. Passages join rooms that no opening reaches: a passage has a
length and no line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.maps.map_extent import MapExtent
from kg.model.areas import Area
from kg.model.errors import LayoutError, QueryParameterError
from perception.binary_masks import connected_components

CELL: Final = 0.2  # [m]
MAX_SIDE: Final = 10_000  # cells along a side of a grid: 2 km in cells of 0.2 m
NO_ROOM: Final = -1
OFF_FLOOR: Final = 1.0  # [m] from the middle of a cell: walls and margins are narrower

Cells = NDArray[np.intp]  # (n,) numbers of floor cells, ix * ny + iy


@dataclass(frozen=True, slots=True)
class Passage:
    """A way between two cells that are no neighbours in the grid."""

    a: int  # number of a cell
    b: int
    metres: float


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """The floor of a building in square cells.

    `low` marks cells of a room that block driving but not sight: tables and beds. Raises
    LayoutError where there is no free floor.
    """

    origin: NDArray[np.float64]  # (2,) [m] in the map frame: the corner of cell (0, 0)
    cell: float  # [m]
    room: NDArray[np.int32]  # (nx, ny) number of the room, NO_ROOM where there is no floor
    passages: tuple[Passage, ...] = ()
    low: NDArray[np.bool_] | None = None  # (nx, ny); None: there are no such cells
    #: (nx, ny) cells that nobody saw, where there may be no way; None: there are no such cells
    unseen: NDArray[np.bool_] | None = None
    free: NDArray[np.bool_] = field(init=False, repr=False)  # (nx, ny) traversable
    open: NDArray[np.bool_] = field(init=False, repr=False)  # (nx, ny) without occlusion

    def __post_init__(self) -> None:
        is_open = self.room != NO_ROOM
        free = is_open if self.low is None else is_open & ~self.low
        if not free.any():
            raise LayoutError("the layout has no free floor; its rooms need an area")
        object.__setattr__(self, "free", free)
        object.__setattr__(self, "open", is_open)

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny)."""
        return self.room.shape[0], self.room.shape[1]

    def floor(self, room: int | None = None) -> Cells:
        """The floor cells of a room, or of the whole building; ascending."""
        return np.flatnonzero(self.free if room is None else self.free & (self.room == room))

    def inside(self, room: int | None = None) -> Cells:
        """The cells of a room, or of the whole building, that may contain objects; ascending."""
        return np.flatnonzero(self.open if room is None else self.room == room)

    def centres(self, cells: ArrayLike) -> NDArray[np.float64]:
        """(n, 2) [m] middles of `cells` in the map frame."""
        at = np.stack(np.divmod(np.asarray(cells, np.intp), self.shape[1]), axis=-1)
        return np.asarray(self.origin + (at + 0.5) * self.cell, np.float64)

    def nearest(self, p_map: ArrayLike, room: int | None = None) -> int:
        """The floor cell nearest to `p_map` (2,) [m], in `room` if given."""
        p = np.asarray(p_map, np.float64)[:2]
        free = self.free if room is None else self.free & (self.room == room)
        at, reach = np.nan_to_num((p - self.origin) / self.cell - 0.5), 2
        while True:  # in ever larger windows, until nothing beyond can be nearer
            low, high = (np.clip(np.rint(at) + s * reach, 0, self.shape) for s in (-1, 1))
            (x, y), (xe, ye) = low.astype(np.intp), high.astype(np.intp) + 1
            ix, iy = np.nonzero(free[x:xe, y:ye])
            whole = not (x or y) and xe >= self.shape[0] and ye >= self.shape[1]
            off = (ix + x - at[0]) ** 2 + (iy + y - at[1]) ** 2
            if whole or (len(off) and off.min() < (reach - 0.5) ** 2):
                cells = (ix + x) * self.shape[1] + iy + y
                offset = self.centres(cells) - p
                return int(cells[np.argmin((offset**2).sum(axis=1))])
            reach *= 8

    def off_floor(self, p_map: ArrayLike, what: str = "start") -> str:
        """A line about a position (2,) [m] that is off the floor, or "".

        `what` names it. Raises QueryParameterError for one too far away to belong to the building.
        """
        p = np.asarray(p_map, np.float64)[:2]
        floor = self.centres(self.floor())
        nearest = floor[np.argmin(((floor - p) ** 2).sum(axis=1))]
        off = float(np.linalg.norm(nearest - p))
        low, high = floor.min(axis=0), floor.max(axis=0)
        if off <= OFF_FLOOR:
            return ""
        x, y, *end = (float(c) for c in (*p, *nearest))
        line = (
            f"the {what} ({x:g}, {y:g}) is {off:,.1f} m off the floor, whose nearest point is "
            f"({end[0]:.1f}, {end[1]:.1f})"
        )
        if off > MapExtent((*low, 0.0), (*high, 0.0)).limit:
            raise QueryParameterError(
                f"{line}: are these millimetres? the floor has x {low[0]:.1f} to {high[0]:.1f} and "
                f"y {low[1]:.1f} to {high[1]:.1f} m; metres in the map frame would work"
            )
        return line

    def without(self, cells: ArrayLike) -> FreeSpace:
        """The same floor with `cells` blocked, by a closed door for example."""
        room = self.room.copy()
        room.reshape(-1)[np.asarray(cells, np.intp)] = NO_ROOM
        return replace(self, room=room)

    def within(self, p_map: ArrayLike, radius: float) -> Cells:
        """Floor cells whose middle is at most `radius` metres from `p_map` (2,) [m]."""
        cells = self.floor()
        offset = self.centres(cells) - np.asarray(p_map, np.float64)[:2]
        return np.asarray(cells[(offset**2).sum(axis=1) <= radius**2], np.intp)

    def reachable(self, start: int) -> NDArray[np.bool_]:
        """(nx, ny) whether a path leads to each cell from cell `start`."""
        part = connected_components(self.free)
        flat = part.reshape(-1)
        reached = {int(flat[start])} - {-1}
        ends = [{int(flat[p.a]), int(flat[p.b])} for p in self.passages]
        ends = [parts for parts in ends if -1 not in parts]
        while further := [parts for parts in ends if parts & reached and parts - reached]:
            reached = reached.union(*further)
        return np.isin(part, list(reached))


def room_labels(
    rooms: Sequence[Area], cell: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """(nx, ny) the room of each cell, and the grid's corner (2,) [m]; without walls and doors.

    Where rooms overlap, cells belong to the smaller one, since a large box often spans a small
    room. The outermost cells are no floor. Raises LayoutError without rooms, and where they span
    more than a grid can hold.
    """
    if not rooms:
        raise LayoutError("a layout needs at least one room")
    corner = np.array([min(r.xmin for r in rooms), min(r.ymin for r in rooms)]) - cell
    far = np.array([max(r.xmax for r in rooms), max(r.ymax for r in rooms)]) + cell
    with np.errstate(over="ignore"):
        span = far - corner
    if not (span <= MAX_SIDE * cell).all():
        raise LayoutError(
            f"the places span {span[0]:.4g} m x {span[1]:.4g} m, more than can be planned on; "
            f"correct their edges to within {MAX_SIDE * cell:.0f} m"
        )
    nx, ny = (int(n) for n in np.ceil(span / cell - 1e-9))
    x, y = (corner[i] + (np.arange(n) + 0.5) * cell for i, n in enumerate((nx, ny)))
    labels = np.full((nx, ny), NO_ROOM, np.int32)
    for number in sorted(range(len(rooms)), key=lambda i: -rooms[i].area):
        room = rooms[number]
        labels[room.contains_each(x[:, None], y[None, :])] = number
    return labels, corner


def with_walls(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """`labels` with a wall of one cell wherever two rooms touch, corners included.

    Of two touching cells, the cell of the larger room becomes wall, so that closets keep their
    floor.
    """
    sizes = np.bincount(labels[labels != NO_ROOM].ravel(), minlength=int(labels.max()) + 1)
    wall = np.zeros(labels.shape, np.bool_)
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = labels[: labels.shape[0] - dx, max(0, -dy) : labels.shape[1] - max(0, dy)]
        b = labels[dx:, max(0, dy) : labels.shape[1] + min(0, dy)]
        touch = (a != b) & (a != NO_ROOM) & (b != NO_ROOM)
        first = touch & (sizes[a] >= sizes[b])
        wall[: labels.shape[0] - dx, max(0, -dy) : labels.shape[1] - max(0, dy)] |= first
        wall[dx:, max(0, dy) : labels.shape[1] + min(0, dy)] |= touch & ~first
    walled = labels.copy()
    walled[wall] = NO_ROOM
    for number in np.flatnonzero(sizes):  # a room as thin as its walls keeps its floor
        if not (walled == number).any():
            walled[labels == number] = number
    return walled


@lru_cache(maxsize=8)
def _lines(cells: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Offsets (k, 2) within `cells` of the middle, and the cells (k, m, 2) on each line to them.

    The cells on a line are the same from either end.
    """
    span = np.arange(-cells, cells + 1)
    offsets = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    offsets = offsets[(offsets**2).sum(axis=1) <= cells**2]
    steps = 2 * cells
    share = np.arange(1, steps) / steps
    between = np.rint(offsets[:, None, :] * share[None, :, None]).astype(np.intp)
    back = (offsets[:, 0] < 0) | ((offsets[:, 0] == 0) & (offsets[:, 1] < 0))
    forth = {tuple(offset): row for row, offset in enumerate(offsets.tolist())}
    for row in np.flatnonzero(back):  # rounding is not symmetric: take the other end's cells
        opposite = forth[tuple((-offsets[row]).tolist())]
        between[row] = between[opposite] + offsets[row]
    return offsets, between


@lru_cache(maxsize=512)  # a plan needs the cells of a viewpoint several times
def visible_cells(space: FreeSpace, cell: int, reach: float) -> tuple[Cells, NDArray[np.float64]]:
    """Cells seen from the middle of `cell` within `reach` metres, and the offsets to them.

    The offsets are (n, 2) [m]. Every line of sight is sampled twice a cell; all samples between its
    ends must be in open cells (`FreeSpace.open`).
    """
    sight = _sight(space, reach)
    ix, iy = divmod(cell, space.shape[1])
    at = ix * sight.stride + iy + sight.middle
    there = np.flatnonzero(sight.is_open[at + sight.target])
    there = there[sight.is_open[at + sight.between[there]].all(axis=1)]
    offsets = sight.offsets[there]
    cells = cell + offsets[:, 0] * space.shape[1] + offsets[:, 1]
    return np.asarray(cells, np.intp), np.asarray(offsets * space.cell, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """The lines of sight of a space as numbers of cells in a grid with closed cells around it."""

    is_open: NDArray[np.bool_]  # (m,)
    stride: int  # cells of the grid along y
    middle: int  # number of the space's first cell
    offsets: NDArray[np.intp]  # (n, 2)
    target: NDArray[np.int32]  # (n,) from the viewpoint's number
    between: NDArray[np.int32]  # (n, s)


@lru_cache(maxsize=4)
def _sight(space: FreeSpace, reach: float) -> _Sight:
    radius = int(np.floor(reach / space.cell + 1e-9))
    offsets, between = _lines(radius)
    is_open = np.pad(space.open, radius)
    stride = is_open.shape[1]
    target, path = (
        np.asarray(part[..., 0] * stride + part[..., 1], np.int32) for part in (offsets, between)
    )
    return _Sight(is_open.reshape(-1), stride, radius * (stride + 1), offsets, target, path)


_MAX_CELLS: Final = 4e5  # of a free space; larger buildings get larger cells
_MIN_RESOLUTION: Final = 0.01  # [m] hundreds of finer cells would make one cell
_MAX_RESOLUTION: Final = 10.0  # [m]
_ISLAND: Final = 1.0  # [m^2] of separate floor below which it counts as noise


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Occupancy grid of a mapping robot's range finder.

    Raises LayoutError where the parts do not fit.
    """

    free: NDArray[np.bool_]  # (nx, ny)
    occupied: NDArray[np.bool_]  # (nx, ny); a cell that is neither is unknown
    origin: NDArray[np.float64]  # (2,) [m] in the map frame: the corner of cell (0, 0)
    resolution: float  # [m] side of a cell

    def __post_init__(self) -> None:
        if self.free.ndim != 2 or self.free.shape != self.occupied.shape:
            raise LayoutError(
                f"free and occupied must both be (nx, ny), got {self.free.shape} and "
                f"{self.occupied.shape}"
            )
        if not _MIN_RESOLUTION <= self.resolution <= _MAX_RESOLUTION:
            raise LayoutError(
                f"the resolution must be {_MIN_RESOLUTION:g} to {_MAX_RESOLUTION:g} m, "
                f"got {self.resolution:g}"
            )
        if np.shape(self.origin) != (2,) or not np.isfinite(self.origin).all():
            raise LayoutError(f"the origin must be two finite numbers [m], got {self.origin}")


def space_of_occupancy(grid: Occupancy, places: Sequence[Area]) -> FreeSpace:
    """Free space of `grid`; room k is the floor in `places[k]`, room n the floor in none of n.

    Where places overlap, cells belong to the smaller one. Cells are blocks of the grid's cells, of
    at least `CELL` metres and larger in a very large building. A block is floor if no cell in it is
    occupied and at least half of it is free, so that thin walls stay closed. Separate floor of less
    than a square metre is left out. Raises LayoutError where there is no floor.
    """
    free, occupied, origin = _cropped(grid)
    side = max(CELL, float(np.sqrt(free.size * grid.resolution**2 / _MAX_CELLS)))
    factor = max(1, int(np.ceil(side / grid.resolution - 1e-6)))
    floor = ~_blocks(occupied, factor).any(axis=(1, 3))
    floor &= _blocks(free, factor).mean(axis=(1, 3)) >= 0.5
    side = factor * grid.resolution
    floor = _without_islands(_without_pinches(floor), _ISLAND / side**2)
    return FreeSpace(origin, side, _rooms(floor, places, origin, side))


def _cropped(
    grid: Occupancy,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
    """The part of a grid around its free cells, and its corner [m]."""
    if not grid.free.any():
        raise LayoutError("the grid has no free cell; is it negated, or in another mode?")
    window, low = [], []
    for axis in (0, 1):
        at = np.flatnonzero(grid.free.any(axis=1 - axis))
        window.append(slice(max(int(at[0]) - 1, 0), int(at[-1]) + 2))
        low.append(window[-1].start)
    corner = grid.origin + np.array(low) * grid.resolution
    return grid.free[tuple(window)], grid.occupied[tuple(window)], corner


def _blocks(cells: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """(nx, factor, ny, factor) blocks of cells, padded with False."""
    padded = np.pad(cells, [(0, -n % factor) for n in cells.shape])
    nx, ny = (n // factor for n in padded.shape)
    return padded.reshape(nx, factor, ny, factor)


def _without_pinches(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`floor` without cells that touch other floor only diagonally, between two walls.

    Lines of sight run along diagonals, so they would cross a slanted wall there.
    """
    tight = floor.copy()
    a, b, c, d = tight[:-1, :-1], tight[1:, 1:], tight[1:, :-1], tight[:-1, 1:]
    pairs = ((a, b, c, d), (c, d, a, b))
    while True:
        pinched = False
        for first, second, one, other in pairs:
            at = first & second & ~one & ~other
            first &= ~at
            pinched |= bool(at.any())
        if not pinched:  # a removed cell may have left another pinch
            return tight


def _without_islands(floor: NDArray[np.bool_], min_cells: float) -> NDArray[np.bool_]:
    """`floor` without parts of less than `min_cells` cells; the largest part always stays."""
    number = connected_components(floor)
    sizes = np.bincount(number[floor], minlength=1)
    large = sizes >= min(min_cells, sizes.max())
    return np.asarray(floor & large[number], np.bool_)


def _rooms(
    floor: NDArray[np.bool_], places: Sequence[Area], origin: NDArray[np.float64], cell: float
) -> NDArray[np.int32]:
    """(nx, ny) number of each floor cell's place; len(places) where it is in none."""
    rooms = np.where(floor, len(places), NO_ROOM).astype(np.int32)
    x, y = (low + (np.arange(n) + 0.5) * cell for low, n in zip(origin, floor.shape, strict=True))
    for number in sorted(range(len(places)), key=lambda k: (-places[k].area, k)):
        place = places[number]
        rooms[floor & place.contains_each(x[:, None], y[None, :])] = number
    return rooms
