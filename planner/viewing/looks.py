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
from planner.viewing.covers import standing_cells
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

    def with_stands(self, space: FreeSpace, stands: Cells) -> Looks:
        """Such looks over the same cells from other `stands`, on a floor that may have changed."""
        kinds = self.kinds
        known = stands[np.isin(stands, self.stands)] if space is self.space else stands[:0]
        new = stands[~np.isin(stands, known)]
        shape = (len(stands), len(kinds), len(self.cells))
        chance = np.zeros(shape, np.float32)
        fields = np.zeros((len(stands), *self.fields.shape[1:]), np.float32)
        kept = np.searchsorted(self.stands, known)
        chance[np.isin(stands, known)] = self.chance.reshape(-1, *shape[1:])[kept]
        fields[np.isin(stands, known)] = self.fields[kept]
        if len(new):
            chance[np.isin(stands, new)] = _chances(space, self.sensor, self.cells, new, kinds)
            fields[np.isin(stands, new)] = distance_fields(space, new)
        return _looks(space, self.sensor, self.motion, self.cells, stands, kinds, chance, fields)

    @property
    def kinds(self) -> list[tuple[float, float]]:
        """(heading, extent) [rad] of the looks from every position."""
        one = self.stand == self.stand[0]
        return list(zip(self.heading[one].tolist(), self.extent[one].tolist(), strict=True))

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
    kinds: Sequence[tuple[float, float]] | None = None,
) -> Looks:
    """Looks from `stands` (default: `standing_cells`): pictures and sweeps in eight headings.

    Or of other `kinds`: (heading, extent) [rad] of the looks from every position.
    """
    sensor, motion = sensor or Sensor(), motion or Motion()
    cells = belief_cells(space) if cells is None else cells
    if stands is None:
        stands = standing_cells(space, sensor.far, near=sensor.near)
    kinds = kinds or _kinds(sensor.field_of_view)
    chance = _chances(space, sensor, cells, stands, kinds)
    fields = distance_fields(space, stands)
    return _looks(space, sensor, motion, cells, stands, kinds, chance, fields)


def _chances(
    space: FreeSpace,
    sensor: Sensor,
    cells: Cells,
    stands: Cells,
    kinds: Sequence[tuple[float, float]],
) -> NDArray[np.float32]:
    """(s, k, c) what looks of `kinds` from each of `stands` show."""
    chance = np.zeros((len(stands), len(kinds), len(cells)), np.float32)
    for rows, stand in zip(chance, stands, strict=True):
        _fill(rows, space, sensor, cells, int(stand), kinds)
    return chance


def _looks(
    space: FreeSpace,
    sensor: Sensor,
    motion: Motion,
    cells: Cells,
    stands: Cells,
    kinds: Sequence[tuple[float, float]],
    chance: NDArray[np.float32],
    fields: NDArray[np.float32],
) -> Looks:
    extent = np.tile([e for _, e in kinds], len(stands))
    return Looks(
        space=space,
        sensor=sensor,
        motion=motion,
        cells=cells,
        stands=stands,
        stand=np.repeat(np.arange(len(stands)), len(kinds)),
        heading=np.tile([h for h, _ in kinds], len(stands)),
        extent=extent,
        seconds=motion.sweep_seconds(extent, sensor.field_of_view),
        chance=chance.reshape(-1, len(cells)),
        fields=fields,
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
