"""Candidate looks: positions on the floor, headings, and what each would show.

A look is a sweep about a heading from a position. Its footprint holds, for each cell of the belief,
the chance to detect what lies there; walls block it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.space.geodesic import distance_fields
from planner.space.grid import Cells, FreeSpace
from planner.space.sight import visible
from planner.viewing.sensor import Motion, Sensor, angle_between

HEADINGS: Final = 8
#: [m] Looks from one square of this size see much the same.
SQUARE: Final = 1.0
#: Sweeps from every position [rad]: one picture, a third of a turn, a whole turn.
EXTENTS: Final = (0.0, 2 * np.pi / 3, 2 * np.pi)


def belief_cells(space: FreeSpace, most: int = 3000) -> Cells:
    """The cells that belief is kept on: all, or a regular sample of at most about `most`.

    Every room keeps at least one.
    """
    floor = space.inside()
    step = int(np.ceil(np.sqrt(len(floor) / most)))
    if step <= 1:
        return floor
    ix, iy = np.divmod(floor, space.shape[1])
    kept = set(floor[(ix % step == 0) & (iy % step == 0)].tolist())
    for room in np.unique(space.room[space.open]):
        cells = space.inside(int(room))
        if kept.isdisjoint(cells.tolist()):
            kept.add(int(cells[len(cells) // 2]))
    return np.array(sorted(kept), np.intp)


def square(space: FreeSpace, cell: int) -> int:
    """The number of the square of `SQUARE` metres that floor cell `cell` lies in."""
    side = max(1, round(SQUARE / space.cell))
    ix, iy = divmod(int(cell), space.shape[1])
    return (ix // side) * space.shape[1] + iy // side


def standing_cells(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    spacing: float = 1.0,
    cover: float = 0.995,
    covers: int = 2,
) -> Cells:
    """Positions to look from that together see at least `cover` of every room, several times over.

    The `covers` covers of `room_covers` have no position in common, so that what one look missed
    can be looked at from elsewhere.
    """
    found = room_covers(space, reach, near=near, spacing=spacing, cover=cover, covers=covers)
    return np.array(sorted({int(cell) for cells in found.values() for cell in cells}), np.intp)


def room_covers(
    space: FreeSpace,
    reach: float,
    *,
    near: float = 0.0,
    spacing: float = 1.0,
    cover: float = 0.98,
    covers: int = 1,
) -> dict[int, Cells]:
    """For each room, cells from which whole turns see at least `cover` of it, `covers` times.

    Candidates stand on a lattice of `spacing` metres, every room's middle among them. The ones that
    see most of what is unseen are taken first (greedy cover): of the room's own, and where these do
    not suffice, of its neighbours'. What is nearer than `near` metres is not seen.
    """
    lattice = {room: _lattice(space, space.floor(room), spacing) for room in _rooms(space)}
    every = np.concatenate(list(lattice.values()))
    seen = _seen_from(space, every, near, reach)
    owner = np.repeat(list(lattice), [len(cells) for cells in lattice.values()])
    taken: set[int] = set()
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


def _rooms(space: FreeSpace) -> list[int]:
    return [int(room) for room in np.unique(space.room[space.free])]


def _seen_from(space: FreeSpace, stands: Cells, near: float, reach: float) -> NDArray[np.bool_]:
    """(n, nx * ny) which cells each of `stands` sees."""
    seen = np.zeros((len(stands), space.room.size), np.bool_)
    for row, stand in zip(seen, stands, strict=True):
        cells, offset = visible(space, int(stand), reach)
        row[cells[(offset**2).sum(axis=1) >= near**2]] = True
    return seen


def _lattice(space: FreeSpace, cells: Cells, spacing: float) -> Cells:
    step = max(1, round(spacing / space.cell))
    ix, iy = np.divmod(cells, space.shape[1])
    on = cells[((ix - ix.min()) % step == step // 2) & ((iy - iy.min()) % step == step // 2)]
    middle = space.centres(cells).mean(axis=0)
    offset = space.centres(cells) - middle
    centre = cells[int(np.argmin((offset**2).sum(axis=1)))]
    return np.unique(np.append(on, centre))


def _greedy_cover(
    seen: NDArray[np.bool_], left: Sequence[int], unseen: NDArray[np.bool_], cover: float
) -> list[int]:
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


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """All candidate looks of a building, by number."""

    space: FreeSpace
    sensor: Sensor
    motion: Motion
    cells: Cells  # (c,) the belief's cells
    stands: Cells  # (s,) positions
    stand: NDArray[np.intp]  # (n,) which position each look is from
    heading: NDArray[np.float64]  # (n,) [rad] the middle of its sweep
    extent: NDArray[np.float64]  # (n,) [rad] seen in one sweep
    seconds: NDArray[np.float64]  # (n,) [s] it takes, without turning towards it
    chance: NDArray[np.float32]  # (n, c) chance to detect what lies in each cell
    fields: NDArray[np.float32]  # (s, nx, ny) [m] shortest ways to each position
    metres: NDArray[np.float64] = field(init=False)  # (s, s) [m] between positions

    def __post_init__(self) -> None:
        between = self.fields.reshape(len(self.stands), -1)[:, self.stands].astype(np.float64)
        object.__setattr__(self, "metres", np.minimum(between, between.T))

    def metres_from(self, cell: int) -> NDArray[np.float64]:
        """(s,) [m] the shortest way from `cell` to each position."""
        return self.fields.reshape(len(self.stands), -1)[:, cell].astype(np.float64)

    def starts(self, looks: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Headings [rad] at the two ends of each sweep; the robot begins at the nearer one."""
        number = np.asarray(looks, np.intp)
        half = np.maximum(self.extent[number] - self.sensor.field_of_view, 0.0) / 2
        return self.heading[number] - half, self.heading[number] + half


def candidate_looks(
    space: FreeSpace,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    *,
    cells: Cells | None = None,
    stands: Cells | None = None,
) -> Looks:
    """Looks from `stands` (default: `standing_cells`): pictures and sweeps in eight headings."""
    sensor, motion = sensor or Sensor(), motion or Motion()
    cells = belief_cells(space) if cells is None else cells
    if stands is None:
        stands = standing_cells(space, sensor.far, near=sensor.near)
    kinds = _kinds(sensor.field_of_view)
    chance = np.zeros((len(stands) * len(kinds), len(cells)), np.float32)
    for number, stand in enumerate(stands):
        rows = chance[number * len(kinds) : (number + 1) * len(kinds)]
        _fill(rows, space, sensor, cells, int(stand), kinds)
    heading = np.tile([h for h, _ in kinds], len(stands))
    extent = np.tile([e for _, e in kinds], len(stands))
    return Looks(
        space=space,
        sensor=sensor,
        motion=motion,
        cells=cells,
        stands=stands,
        stand=np.repeat(np.arange(len(stands)), len(kinds)),
        heading=heading,
        extent=extent,
        seconds=motion.sweep_seconds(extent, sensor.field_of_view),
        chance=chance,
        fields=distance_fields(space, stands),
    )


def _kinds(field_of_view: float) -> list[tuple[float, float]]:
    """(heading, extent) of the looks from one position."""
    headings = np.arange(HEADINGS) * 2 * np.pi / HEADINGS - np.pi
    sweeps = sorted({max(extent, field_of_view) for extent in EXTENTS})
    whole = 2 * np.pi - 1e-9
    found = [(float(h), e) for e in sweeps if e < whole for h in headings]
    return [*found, (0.0, 2 * np.pi)]


def _fill(
    rows: NDArray[np.float32],
    space: FreeSpace,
    sensor: Sensor,
    cells: Cells,
    stand: int,
    kinds: Sequence[tuple[float, float]],
) -> None:
    seen, offset = visible(space, stand, sensor.far)
    at = np.searchsorted(cells, seen)
    kept = (at < len(cells)) & (cells[np.minimum(at, len(cells) - 1)] == seen)
    at, offset = at[kept], offset[kept]
    chance = sensor.chance(np.hypot(offset[:, 0], offset[:, 1]))
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    for row, (heading, extent) in zip(rows, kinds, strict=True):
        inside = angle_between(bearing, heading) <= extent / 2 + 1e-9
        row[at[inside]] = chance[inside]


def picture(looks: Looks, cell: int, heading: float) -> NDArray[np.float32]:
    """(c,) chance to detect in one picture from `cell` towards `heading`, e.g. on the way."""
    row = np.zeros((1, len(looks.cells)), np.float32)
    kind = [(heading, looks.sensor.field_of_view)]
    _fill(row, looks.space, looks.sensor, looks.cells, cell, kind)
    return np.array(row[0])
