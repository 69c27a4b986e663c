"""Covering viewpoints: positions from which a robot sees nearly all of every room (set cover)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.grid import Cells, FreeSpace, visible_cells

SPACING: Final = 1.0  # [m] of the lattice of viewpoints
COVER: Final = 0.995  # share of every room that covering viewpoints see
COVERS: Final = 4  # times that they see it: the robot has a choice of positions


def covering_viewpoints(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    covers: int = COVERS,
    besides: ArrayLike = (),
) -> Cells:
    """Viewpoints that together see at least the share `COVER` of every room, `covers` times.

    The covers of `room_viewpoints` have no viewpoint in common, nor with `besides`, so that another
    viewpoint can see an object that one view missed. Where they leave too much of a room unseen, a
    closet for example, any floor cell that sees it can be a viewpoint.
    """
    found = room_viewpoints(space, reach, near=near, cover=COVER, covers=covers, besides=besides)
    chosen = {int(cell) for cells in found.values() for cell in cells}
    known = chosen.union(np.asarray(besides, np.intp).tolist())
    chosen.update(_peepholes(space, sorted(known), near, reach))
    return np.array(sorted(chosen), np.intp)


def room_viewpoints(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    cover: float = 0.98,
    covers: int = 1,
    besides: ArrayLike = (),
) -> dict[int, Cells]:
    """For each room, cells from which whole turns see at least `cover` of it, `covers` times.

    Candidates are a lattice with the middle of every room. Greedy set cover takes the candidate
    that sees the most unseen cells first, from the room itself, then from other rooms. Cells nearer
    than `near` metres are not seen. `besides` are not taken.
    """
    rooms = np.unique(space.room[space.free])
    lattice = {int(room): _lattice(space, space.floor(int(room))) for room in rooms}
    candidates = np.concatenate(list(lattice.values()))
    owner = np.repeat(list(lattice), [len(cells) for cells in lattice.values()])
    shown = _shown_in_rooms(space, candidates, near, reach)
    taken = set(np.flatnonzero(np.isin(candidates, np.asarray(besides, np.intp))).tolist())
    found: dict[int, Cells] = {}
    for room in lattice:
        who, inside = shown[room]
        chosen: list[int] = []
        for _ in range(covers):
            unseen = np.ones(inside.shape[1], np.bool_)
            for among in (owner[who] == room, owner[who] != room):
                left = [int(i) for i in np.flatnonzero(among) if int(who[i]) not in taken]
                picked = who[_greedy_cover(inside, left, unseen, cover)].tolist()
                chosen += picked
                taken.update(picked)
        found[room] = candidates[chosen]
    return found


def _shown_in_rooms(
    space: FreeSpace, candidates: Cells, near: float, reach: float
) -> dict[int, tuple[NDArray[np.intp], NDArray[np.float32]]]:
    """For each room, the numbers (n,) of `candidates` that show some of it, and what: (n, c) 0, 1.

    The c cells are those of `FreeSpace.inside`.
    """
    shown = [_shown(space, int(cell), near, reach) for cell in candidates]
    cell = np.concatenate(shown)
    who = np.repeat(np.arange(len(candidates)), [len(cells) for cells in shown])
    room = space.room.reshape(-1)[cell]
    by_room = np.argsort(room, kind="stable")
    ends = np.searchsorted(room[by_room], np.arange(int(space.room.max()) + 2))
    found = {}
    for number in np.unique(space.room[space.free]).tolist():
        part = by_room[ends[number] : ends[number + 1]]
        seeing, row = np.unique(who[part], return_inverse=True)
        cells = space.inside(number)
        rows = np.zeros((len(seeing), len(cells)), np.float32)
        rows[row, np.searchsorted(cells, cell[part])] = 1.0
        found[number] = seeing, rows
    return found


def _peepholes(space: FreeSpace, viewpoints: Sequence[int], near: float, reach: float) -> list[int]:
    """Further viewpoints for rooms that `viewpoints` see less than the share `COVER` of.

    A room without free floor, full of tables for example, is seen from the floor of other rooms.
    """
    unseen = np.zeros(space.room.size, np.bool_)
    unseen[space.inside()] = True
    free = space.free.reshape(-1)
    for viewpoint in viewpoints:
        unseen[_shown(space, viewpoint, near, reach)] = False
    taken: list[int] = []
    for room in np.unique(space.room[space.open]):
        cells = space.inside(int(room))
        if unseen[cells].mean() <= 1 - COVER:
            continue
        views = {int(cell): _shown(space, int(cell), near, reach) for cell in cells[unseen[cells]]}
        while unseen[cells].mean() > 1 - COVER:
            left = [views[int(cell)] for cell in cells[unseen[cells]]]
            count = np.bincount(np.concatenate(left), minlength=unseen.size) * free
            best = int(np.argmax(count))  # lines of sight are symmetric
            if not count[best]:
                break
            taken.append(best)
            unseen[_shown(space, best, near, reach)] = False
    return taken


def _shown(space: FreeSpace, viewpoint: int, near: float, reach: float) -> Cells:
    """The cells seen from `viewpoint`, none nearer than `near` [m]."""
    cells, offset = visible_cells(space, viewpoint, reach)
    return np.asarray(cells[(offset**2).sum(axis=1) >= near**2], np.intp)


def _lattice(space: FreeSpace, cells: Cells) -> Cells:
    step = max(1, round(SPACING / space.cell))
    ix, iy = np.divmod(cells, space.shape[1])
    on = cells[((ix - ix.min()) % step == step // 2) & ((iy - iy.min()) % step == step // 2)]
    middle = space.centres(cells).mean(axis=0)
    offset = space.centres(cells) - middle
    centre = cells[int(np.argmin((offset**2).sum(axis=1)))]
    return np.unique(np.append(on, centre))


def _greedy_cover(
    seen: NDArray[np.float32], left: Sequence[int], unseen: NDArray[np.bool_], cover: float
) -> list[int]:
    """Rows of `seen` (n, c) among `left` that leave little unseen; updates `unseen` (c,)."""
    rows = seen[list(left)]
    taken: list[int] = []
    while len(rows) and unseen.mean() > 1 - cover:
        gains = rows @ unseen.astype(np.float32)  # counts, which are exact
        best = int(np.argmax(gains))
        if not gains[best]:
            break
        taken.append(left[best])
        unseen &= rows[best] == 0
    return taken
