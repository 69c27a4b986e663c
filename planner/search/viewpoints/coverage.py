"""Viewpoint coverage: few viewpoints that together see every room, by greedy set cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.grid import Cells, FreeSpace, visible_cells

_Seen = NDArray[np.bool_]


def covering_viewpoints(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    spacing: float = 1.0,
    cover: float = 0.995,
    covers: int = 2,
    besides: ArrayLike = (),
) -> Cells:
    """Viewpoints that together see at least `cover` of every room, `covers` times.

    The covers of `room_viewpoints` have no viewpoint in common, nor with `besides`, so that an
    object that one view missed can be seen from elsewhere. Where they leave too much of a room
    unseen, a closet for example, any floor cell that sees it can be a viewpoint.
    """
    found = room_viewpoints(
        space, reach, near=near, spacing=spacing, cover=cover, covers=covers, besides=besides
    )
    chosen = {int(cell) for cells in found.values() for cell in cells}
    known = chosen.union(np.asarray(besides, np.intp).tolist())
    chosen.update(_peepholes(space, sorted(known), near, reach, cover))
    return np.array(sorted(chosen), np.intp)


def room_viewpoints(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    spacing: float = 1.0,
    cover: float = 0.98,
    covers: int = 1,
    besides: ArrayLike = (),
) -> dict[int, Cells]:
    """For each room, cells from which whole turns see at least `cover` of it, `covers` times.

    Candidates lie on a lattice of `spacing` metres, with the middle of every room. The one that
    sees the most unseen cells is taken first (greedy set cover), from the room itself, then from
    its neighbours. Cells nearer than `near` metres are not seen. `besides` are not taken.
    """
    lattice = {room: _lattice(space, space.floor(room), spacing) for room in _rooms(space)}
    every = np.concatenate(list(lattice.values()))
    seen = _seen_from(space, every, near, reach)
    owner = np.repeat(list(lattice), [len(cells) for cells in lattice.values()])
    taken = set(np.flatnonzero(np.isin(every, np.asarray(besides, np.intp))).tolist())
    found: dict[int, Cells] = {}
    for room in lattice:
        inside = seen[:, space.inside(room)]
        chosen: list[int] = []
        for _ in range(covers):
            unseen = np.ones(inside.shape[1], np.bool_)
            for among in (owner == room, owner != room):
                left = [int(i) for i in np.flatnonzero(among) if i not in taken]
                picked = _greedy_cover(inside, left, unseen, cover)
                chosen += picked
                taken.update(picked)
        found[room] = every[chosen]
    return found


def _peepholes(
    space: FreeSpace, viewpoints: Sequence[int], near: float, reach: float, cover: float
) -> list[int]:
    """Floor that sees what `viewpoints` leave unseen of rooms of which they see less than `cover`.

    Of rooms with nothing but tables in them too: these are seen from the floor of others.
    """
    unseen = np.zeros(space.room.size, np.bool_)
    unseen[space.inside()] = True
    free = space.free.reshape(-1)
    for viewpoint in viewpoints:
        unseen[_shown(space, viewpoint, near, reach)] = False
    taken: list[int] = []
    for room in np.unique(space.room[space.open]):
        cells = space.inside(int(room))
        if unseen[cells].mean() <= 1 - cover:
            continue
        views = {int(cell): _shown(space, int(cell), near, reach) for cell in cells[unseen[cells]]}
        while unseen[cells].mean() > 1 - cover:
            left = [views[int(cell)] for cell in cells[unseen[cells]]]
            count = np.bincount(np.concatenate(left), minlength=unseen.size) * free
            best = int(np.argmax(count))  # sight is the same in both directions
            if not count[best]:
                break
            taken.append(best)
            unseen[_shown(space, best, near, reach)] = False
    return taken


def _shown(space: FreeSpace, viewpoint: int, near: float, reach: float) -> Cells:
    """The cells seen from `viewpoint`, none nearer than `near` [m]."""
    cells, offset = visible_cells(space, viewpoint, reach)
    return np.asarray(cells[(offset**2).sum(axis=1) >= near**2], np.intp)


def _rooms(space: FreeSpace) -> list[int]:
    return [int(room) for room in np.unique(space.room[space.free])]


def _seen_from(space: FreeSpace, viewpoints: Cells, near: float, reach: float) -> _Seen:
    """(n, nx * ny) which cells each of `viewpoints` sees."""
    seen = np.zeros((len(viewpoints), space.room.size), np.bool_)
    for row, viewpoint in zip(seen, viewpoints, strict=True):
        row[_shown(space, int(viewpoint), near, reach)] = True
    return seen


def _lattice(space: FreeSpace, cells: Cells, spacing: float) -> Cells:
    step = max(1, round(spacing / space.cell))
    ix, iy = np.divmod(cells, space.shape[1])
    on = cells[((ix - ix.min()) % step == step // 2) & ((iy - iy.min()) % step == step // 2)]
    middle = space.centres(cells).mean(axis=0)
    offset = space.centres(cells) - middle
    centre = cells[int(np.argmin((offset**2).sum(axis=1)))]
    return np.unique(np.append(on, centre))


def _greedy_cover(seen: _Seen, left: Sequence[int], unseen: _Seen, cover: float) -> list[int]:
    """Rows of `seen` (n, c), of those in `left`, that leave little unseen; updates `unseen`."""
    rows = seen[list(left)]
    taken: list[int] = []
    while len(rows) and unseen.mean() > 1 - cover:
        gains = (rows & unseen).sum(axis=1)
        best = int(np.argmax(gains))
        if not gains[best]:
            break
        taken.append(left[best])
        unseen &= ~rows[best]
    return taken
