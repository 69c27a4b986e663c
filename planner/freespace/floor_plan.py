"""Free space of a building: from rooms and doors, or from the observed floor with its frontiers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area
from kg.model.records import FREE, LOW, TALL, UNKNOWN
from mapping.occupancy.mapped_floor import MappedFloor, States
from perception.binary_masks import connected_components, with_neighbours
from planner.freespace.grid import (
    CELL,
    NO_ROOM,
    Cells,
    FreeSpace,
    Passage,
    room_labels,
    with_walls,
)

DOOR: Final = 0.9  # [m] width of an opening
GAP: Final = 1.0  # [m] between rooms from which on a passage joins them, not an opening
TOUCH: Final = 0.5  # [m] between rooms up to which an opening is assumed
JUMP: Final = 5.0  # [m] greatest length of a passage


def free_space(
    rooms: Sequence[Area], doors: Iterable[tuple[int, int]] | None = None, *, cell: float = CELL
) -> FreeSpace:
    """The free space of `rooms`; `doors` are pairs of their numbers.

    Without `doors`, a door is assumed in the middle of every wall that two rooms share along at
    least its width. A passage joins each unreachable room to the nearest floor.

    Raises LayoutError where there is no floor.
    """
    labels, origin = room_labels(rooms, cell)
    walled = with_walls(labels)
    pairs = _touching(rooms) if doors is None else sorted({(min(d), max(d)) for d in doors})
    passages: list[Passage] = []
    for pair in pairs:
        _join(walled, pair, cell, passages)
    return joined(FreeSpace(origin, cell, walled, tuple(passages)))


def _touching(rooms: Sequence[Area]) -> list[tuple[int, int]]:
    found = []
    for (i, a), (j, b) in combinations(enumerate(rooms), 2):
        across = min(a.xmax, b.xmax) - max(a.xmin, b.xmin)
        along = min(a.ymax, b.ymax) - max(a.ymin, b.ymin)
        if min(across, along) >= -TOUCH and max(across, along) >= DOOR:
            found.append((i, j))
    return sorted(found, key=lambda pair: pair[::-1])


def _join(
    labels: NDArray[np.int32], pair: tuple[int, int], cell: float, passages: list[Passage]
) -> None:
    """Cut an opening where two rooms are nearest; add a passage where that is too far."""
    first, second = (np.argwhere(_edge(labels == room)) for room in pair)
    if not len(first) or not len(second):
        return
    between = ((first[:, None, :] - second[None, :, :]) ** 2).sum(axis=2)
    nearest = np.argwhere(between <= between.min() + 1e-9)
    i, j = nearest[len(nearest) // 2]  # the middle one of the nearest pairs
    metres = float(np.sqrt(between[i, j])) * cell
    if metres > GAP:
        a, b = (int(ix * labels.shape[1] + iy) for ix, iy in (first[i], second[j]))
        passages.append(Passage(a, b, min(metres, JUMP)))
    else:
        _cut(labels, first[i], second[j], cell)


def _cut(labels: NDArray[np.int32], a: NDArray[np.intp], b: NDArray[np.intp], cell: float) -> None:
    """Turn the cells around the line from `a` to `b` into floor, as wide as a door."""
    half = DOOR / 2 / cell
    low = np.floor(np.minimum(a, b) - half).astype(int)
    high = np.ceil(np.maximum(a, b) + half).astype(int)
    window = tuple(slice(max(lo, 0), hi + 1) for lo, hi in zip(low, high, strict=True))
    ix, iy = np.indices(labels[window].shape)
    at = np.stack([ix + max(low[0], 0), iy + max(low[1], 0)], axis=-1).astype(float)
    way = (b - a).astype(float)
    along = np.clip(((at - a) @ way) / max(float(way @ way), 1e-9), 0.0, 1.0)
    off = np.linalg.norm(at - (a + along[..., None] * way), axis=-1)
    part = labels[window]
    opened = (part == NO_ROOM) & (off <= half) & (along > 0) & (along < 1)
    part[opened] = np.where(along[opened] < 0.5, labels[tuple(a)], labels[tuple(b)])


def joined(space: FreeSpace) -> FreeSpace:
    """`space` with passages to all unreachable floor."""
    passages = list(space.passages)
    while True:
        space = replace(space, passages=tuple(passages))
        floor = space.floor()
        reached = space.reachable(int(floor[0])).reshape(-1)
        inside, outside = floor[reached[floor]], floor[~reached[floor]]
        if not len(outside):
            return space
        passages.append(_shortest_link(space, inside, outside))


def _shortest_link(
    space: FreeSpace, inside: NDArray[np.intp], outside: NDArray[np.intp]
) -> Passage:
    best, rated = None, np.inf
    inside = _border(space, inside)
    p_in = space.centres(inside)
    for cell in _border(space, outside):
        metres = np.linalg.norm(p_in - space.centres([cell]), axis=1)
        i = int(np.argmin(metres))
        if metres[i] < rated:
            best, rated = (int(inside[i]), int(cell)), float(metres[i])
    assert best is not None, "there is a cell on both sides"
    return Passage(*best, min(rated, JUMP))


def _border(space: FreeSpace, cells: NDArray[np.intp]) -> NDArray[np.intp]:
    """The cells of `cells` with a neighbour along an axis that is not among them."""
    held = np.zeros(space.shape, np.bool_)
    held[np.unravel_index(cells, space.shape)] = True
    return np.asarray(cells[_edge(held).reshape(-1)[cells]])


def _edge(held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells (nx, ny) of an area with a neighbour along an axis that is not among them."""
    around = np.pad(held, 1)
    return held & ~(around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:])


MIN_FINE_CELLS: Final = 2  # occupied fine cells that make a cell an obstacle; fewer are noise
_ISLAND: Final = 1.0  # [m^2] of separate floor below which it counts as noise
_WHOLE: Final = 0.5  # share of an unobserved room from which on its separate floor is kept


@dataclass(frozen=True, slots=True, eq=False)
class SeenSpace:
    """Free space, and its observed states."""

    space: FreeSpace
    rooms: int  # number of rooms given; also the number of the room of floor in none of them
    states: States  # (nx, ny) observed state of each cell
    within: NDArray[np.bool_]  # (nx, ny) whether a cell lies in a given room


def seen_space(
    assumed: FreeSpace, rooms: Sequence[Area], floor: MappedFloor, *, margin: float = 0.0
) -> SeenSpace:
    """`assumed` free space of `rooms`, overwritten by the observed cells of `floor`.

    Room len(rooms) is the floor in none of them. The grid reaches `margin` [m] beyond the observed
    floor.
    """
    space = _widened(assumed, floor, margin)
    states = _coarse(space, floor)
    labels = _labels(space, rooms)
    room = np.where(space.free, space.room, NO_ROOM)
    known = (states == FREE) | (states == LOW)
    room[known] = np.where(space.room[known] != NO_ROOM, space.room[known], labels[known])
    room[states == TALL] = NO_ROOM
    wide = with_neighbours(~with_neighbours(room == NO_ROOM))
    room[(states == UNKNOWN) & ~wide] = NO_ROOM  # within a wall, or behind what stands at one
    low = states == LOW
    room = _without_islands(room, low, states, labels, len(rooms), _ISLAND / space.cell**2)
    mixed = FreeSpace(space.origin, space.cell, room, _valid(space, room, low), low)
    return SeenSpace(joined(mixed), len(rooms), states, labels != len(rooms))


def _widened(space: FreeSpace, floor: MappedFloor, margin: float) -> FreeSpace:
    """The same floor on a grid that also covers the observed `floor`."""
    low, high = floor.bounds + np.array([[-margin], [margin]])
    size = np.array(space.shape) * space.cell
    before = np.maximum(np.ceil((space.origin - low) / space.cell - 1e-9), 0).astype(int)
    after = np.maximum(np.ceil((high - space.origin - size) / space.cell - 1e-9), 0).astype(int)
    pad = list(zip(before, after, strict=True))
    room = np.pad(space.room, pad, constant_values=NO_ROOM)

    def moved(cell: int) -> int:
        i, j = divmod(cell, space.shape[1])
        return int((i + before[0]) * room.shape[1] + j + before[1])

    passages = tuple(replace(p, a=moved(p.a), b=moved(p.b)) for p in space.passages)
    return FreeSpace(space.origin - before * space.cell, space.cell, room, passages)


def _coarse(space: FreeSpace, floor: MappedFloor) -> States:
    """(nx, ny) observed states of the cells of `space`.

    A cell is an obstacle if two of its fine cells are, and free if half of its fine cells are.
    """
    nx, ny = space.shape
    size, fine = space.cell, floor.resolution
    at = np.argwhere(floor.states != UNKNOWN)
    state = floor.states[tuple(at.T)]
    p_map = floor.origin + (at + 0.5) * fine
    x, y = np.floor((p_map - space.origin) / size).astype(np.intp).T
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny)

    def count(*states: int) -> NDArray[np.intp]:
        chosen = np.isin(state, states) & inside
        return np.bincount(x[chosen] * ny + y[chosen], minlength=nx * ny).reshape(nx, ny)

    found = np.full((nx, ny), UNKNOWN, np.uint8)
    found[count(FREE) >= (size / fine) ** 2 / 2] = FREE
    found[count(LOW, TALL) >= MIN_FINE_CELLS] = LOW
    found[count(TALL) >= MIN_FINE_CELLS] = TALL
    return found


def _labels(space: FreeSpace, rooms: Sequence[Area]) -> NDArray[np.int32]:
    """(nx, ny) number of the room that each cell lies in, the smaller of two; len(rooms): none."""
    labels = np.full(space.shape, len(rooms), np.int32)
    if not rooms:
        return labels
    found, corner = room_labels(rooms, space.cell)
    i, j = (int(n) for n in np.rint((corner - space.origin) / space.cell))
    part = labels[i : i + found.shape[0], j : j + found.shape[1]]
    part[found != NO_ROOM] = found[found != NO_ROOM]
    return labels


def _without_islands(
    room: NDArray[np.int32],
    low: NDArray[np.bool_],
    states: States,
    labels: NDArray[np.int32],
    count: int,
    min_cells: float,
) -> NDArray[np.int32]:
    """`room` without separate floor, unless `min_cells` cells of it were observed.

    So floor outside of the walls is removed where the area of a place includes it. In an unobserved
    room, separate floor stays if it is at least half of the room.
    """
    floor = (room != NO_ROOM) & ~low
    number = connected_components(floor)
    sizes = np.bincount(number[floor], minlength=1)
    if not sizes.any():
        return room
    seen = np.bincount(number[floor & (states == FREE)], minlength=len(sizes))
    keep = seen >= min_cells
    keep[int(np.argmax(sizes if not seen.any() else seen))] = True
    room_sizes = np.bincount(labels.ravel(), minlength=count + 1)
    seen_of_room = np.bincount(labels[states == FREE], minlength=count + 1)
    for k in np.flatnonzero(seen_of_room[:count] < min_cells):
        of_room = np.bincount(number[floor & (labels == k)], minlength=len(sizes))
        keep |= of_room >= max(_WHOLE * int(room_sizes[k]), 1)
    kept = np.where(floor & ~keep[number], NO_ROOM, room).astype(np.int32)
    number = connected_components(kept != NO_ROOM)
    only_low = ~np.isin(number, np.unique(number[(kept != NO_ROOM) & ~low]))  # specks in the walls
    kept[only_low] = NO_ROOM
    return kept


def _valid(
    space: FreeSpace, room: NDArray[np.int32], low: NDArray[np.bool_]
) -> tuple[Passage, ...]:
    """The passages of `space` with both ends on floor."""
    floor = ((room != NO_ROOM) & ~low).reshape(-1)
    return tuple(p for p in space.passages if floor[p.a] and floor[p.b])


BEHIND: Final = 2.6  # [m] of floor assumed beyond a frontier
MIN_WIDTH: Final = 0.6  # [m] of a frontier; a robot does not fit through narrower ones
MIN_AREA: Final = 2.0  # [m^2] of floor beyond a frontier; less is no room
MAX_FRONTIERS: Final = 20  # the widest ones are kept

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Frontier:
    """Frontier between observed and unknown floor."""

    p_map: NDArray[np.float64]  # (2,) [m] the observed cell in its middle
    width: float  # [m]
    behind: Cells  # (n,) cells assumed to be floor beyond it


def with_frontiers(seen: SeenSpace) -> tuple[SeenSpace, tuple[Frontier, ...]]:
    """The floor with assumed floor beyond its frontiers, and the frontiers.

    The floor beyond frontier k is room `seen.rooms + 1 + k`.
    """
    space, cell = seen.space, seen.space.cell
    unknown = (seen.states == UNKNOWN) & ~seen.within & (space.room == NO_ROOM)
    edge = space.free & (seen.states == FREE) & with_neighbours(unknown)
    region = _reached(with_neighbours(edge) & unknown, unknown, round(BEHIND / cell))
    number = connected_components(region)
    touching = _neighbour_numbers(number, edge)
    found = []
    for part in np.unique(touching[touching >= 0]):
        cells = np.flatnonzero(number == part)
        at = np.flatnonzero(touching == part)
        wide, large = len(at) * cell, len(cells) * cell**2
        if wide >= MIN_WIDTH - 1e-9 and large >= MIN_AREA:
            xy = space.centres(at)
            middle = xy[int(np.argmin(((xy - xy.mean(axis=0)) ** 2).sum(axis=1)))]
            found.append(Frontier(middle, wide, cells))
    found = sorted(found, key=lambda f: (-f.width, int(f.behind[0])))[:MAX_FRONTIERS]
    room = space.room.copy()
    for k, frontier in enumerate(found):
        room.reshape(-1)[frontier.behind] = seen.rooms + 1 + k
    return replace(seen, space=replace(space, room=room)), tuple(found)


def _reached(start: Mask, through: Mask, steps: int) -> Mask:
    """Cells of `through` that are at most `steps` cells from `start`."""
    reached = start
    for _ in range(steps - 1):
        reached = reached | (with_neighbours(reached) & through)
    return reached


def _neighbour_numbers(number: NDArray[np.int64], edge: Mask) -> NDArray[np.int64]:
    """(nx, ny) number of the part beside each cell of `edge`; -1 elsewhere."""
    around = np.pad(number, 1, constant_values=-1)
    sides = (around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:])
    return np.where(edge, np.max(sides, axis=0), -1)
