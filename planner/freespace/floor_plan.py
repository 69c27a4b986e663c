"""A building of rooms and doors as free space: walls raised, doors cut, islands joined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.freespace.grid import CELL, NO_ROOM, FreeSpace, Passage, Room, room_labels, with_walls

DOOR: Final = 0.9  # [m] width of an opening
GAP: Final = 1.0  # [m] between rooms from which on a passage joins them, not an opening
TOUCH: Final = 0.5  # [m] between rooms up to which an opening is assumed
STOREY: Final = 1.2  # [m] between floor heights from which on they are different storeys
CLIMB: Final = 2.0  # metres walked for each metre of height on stairs


def free_space(
    rooms: Sequence[Room], doors: Iterable[tuple[int, int]] | None = None, *, cell: float = CELL
) -> FreeSpace:
    """The free space of `rooms`; `doors` are pairs of their numbers.

    Without `doors`, a door is assumed in the middle of every wall that two rooms share along at
    least its width. A passage joins each unreachable room to the nearest floor. Storeys lie side by
    side in the grid, at the offsets of `shifts`, and are joined by passages only.

    Raises LayoutError where there is no floor.
    """
    flat = [room.shifted(float(dx)) for room, dx in zip(rooms, shifts(rooms), strict=True)]
    labels, origin = room_labels(flat, cell)
    walled = with_walls(labels)
    pairs = _touching(flat) if doors is None else sorted({(min(d), max(d)) for d in doors})
    passages: list[Passage] = []
    for a, b in pairs:
        _join(walled, flat, (a, b), cell, passages)
    space = FreeSpace(origin, cell, walled, tuple(passages))
    return joined(space, [room.height for room in flat])


def shifts(rooms: Sequence[Room]) -> NDArray[np.float64]:
    """(n,) [m] offset of each room along x, so that storeys do not overlap."""
    number: dict[float, int] = {}
    lowest, storey = -np.inf, -1
    for height in sorted({room.height for room in rooms}):
        if height - lowest > STOREY:
            lowest, storey = height, storey + 1
        number[height] = storey
    width = max((r.xmax for r in rooms), default=0.0) - min((r.xmin for r in rooms), default=0.0)
    return np.array([number[room.height] * (width + 5.0) for room in rooms], np.float64)


def _touching(rooms: Sequence[Room]) -> list[tuple[int, int]]:
    found = []
    for (i, a), (j, b) in combinations(enumerate(rooms), 2):
        across = min(a.xmax, b.xmax) - max(a.xmin, b.xmin)
        along = min(a.ymax, b.ymax) - max(a.ymin, b.ymin)
        if min(across, along) >= -TOUCH and max(across, along) >= DOOR:
            found.append((i, j))
    return sorted(found, key=lambda pair: pair[::-1])


def _join(
    labels: NDArray[np.int32],
    rooms: Sequence[Room],
    pair: tuple[int, int],
    cell: float,
    passages: list[Passage],
) -> None:
    """Cut an opening where two rooms are nearest; add a passage where that is too far."""
    first, second = (np.argwhere(labels == room) for room in pair)
    if not len(first) or not len(second):
        return
    between = ((first[:, None, :] - second[None, :, :]) ** 2).sum(axis=2)
    nearest = np.argwhere(between <= between.min() + 1e-9)
    i, j = nearest[len(nearest) // 2]  # the middle one of the nearest pairs
    metres = float(np.sqrt(between[i, j])) * cell
    climb = abs(rooms[pair[0]].height - rooms[pair[1]].height)
    if metres > GAP or climb > STOREY:
        a, b = (int(ix * labels.shape[1] + iy) for ix, iy in (first[i], second[j]))
        passages.append(Passage(a, b, min(metres, 5.0) + CLIMB * climb))
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


def joined(space: FreeSpace, heights: Sequence[float]) -> FreeSpace:
    """`space` with passages to all unreachable floor; `heights` [m] of its rooms' floors."""
    passages = list(space.passages)
    while True:
        space = replace(space, passages=tuple(passages))
        floor = space.floor()
        reached = space.reachable(int(floor[0])).reshape(-1)
        inside, outside = floor[reached[floor]], floor[~reached[floor]]
        if not len(outside):
            return space
        passages.append(_shortest_link(space, heights, inside, outside))


def _shortest_link(
    space: FreeSpace, heights: Sequence[float], inside: NDArray[np.intp], outside: NDArray[np.intp]
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
    a, b = (heights[int(space.room.reshape(-1)[cell])] for cell in best)
    return Passage(*best, min(rated, 5.0) + CLIMB * abs(a - b))


def _border(space: FreeSpace, cells: NDArray[np.intp]) -> NDArray[np.intp]:
    """The cells of `cells` with a neighbour along an axis that is not among them."""
    held = np.zeros(np.add(space.shape, 2), np.bool_)
    inner = held[1:-1, 1:-1]
    inner[np.unravel_index(cells, space.shape)] = True
    enclosed = held[:-2, 1:-1] & held[2:, 1:-1] & held[1:-1, :-2] & held[1:-1, 2:]
    return np.asarray(cells[~enclosed.reshape(-1)[cells]])
