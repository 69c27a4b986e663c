"""Candidate views: viewpoints on the floor, headings, and the cells that each view shows.

A view is a sweep of the camera about a heading, from a viewpoint. Its footprint is the probability
to detect an object in each cell of the belief; walls block it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapping.occupancy.mapped_floor import FloorView
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import Cells, FreeSpace, visible_cells
from planner.search.viewpoints.coverage import covering_viewpoints
from planner.search.viewpoints.sensor import Motion, Sensor, angle_between

HEADINGS: Final = 8
#: [m] Side of a square; views from one square show much the same.
SQUARE: Final = 1.0
#: Sweeps from every viewpoint [rad]: one picture, a third of a turn, a whole turn.
EXTENTS: Final = (0.0, 2 * np.pi / 3, 2 * np.pi)


def belief_cells(space: FreeSpace, most: int = 3000) -> Cells:
    """Cells of the belief: all of the floor, or a regular sample of at most about `most`.

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
class CandidateViews:
    """All candidate views of a building, by number."""

    space: FreeSpace
    sensor: Sensor
    motion: Motion
    cells: Cells  # (c,) the belief's cells
    viewpoints: Cells  # (s,)
    viewpoint: NDArray[np.intp]  # (n,) which viewpoint each view is from
    heading: NDArray[np.float64]  # (n,) [rad] the middle of its sweep
    extent: NDArray[np.float64]  # (n,) [rad] seen in one sweep
    seconds: NDArray[np.float64]  # (n,) [s] it takes, without turning towards it
    chance: NDArray[np.float32]  # (n, c) chance to detect what lies in each cell
    fields: NDArray[np.float32]  # (s, nx, ny) [m] shortest ways to each viewpoint
    metres: NDArray[np.float64] = field(init=False)  # (s, s) [m] between viewpoints

    def __post_init__(self) -> None:
        between = self.fields.reshape(len(self.viewpoints), -1)[:, self.viewpoints].astype(
            np.float64
        )
        object.__setattr__(self, "metres", np.minimum(between, between.T))

    def metres_from(self, cell: int) -> NDArray[np.float64]:
        """(s,) [m] the shortest way from `cell` to each viewpoint."""
        return self.fields.reshape(len(self.viewpoints), -1)[:, cell].astype(np.float64)

    def with_viewpoints(self, space: FreeSpace, viewpoints: Cells) -> CandidateViews:
        """Views over the same cells from other `viewpoints`, on a floor that may have changed."""
        kinds = self.kinds
        known = (
            viewpoints[np.isin(viewpoints, self.viewpoints)]
            if space is self.space
            else viewpoints[:0]
        )
        new = viewpoints[~np.isin(viewpoints, known)]
        shape = (len(viewpoints), len(kinds), len(self.cells))
        chance = np.zeros(shape, np.float32)
        fields = np.zeros((len(viewpoints), *self.fields.shape[1:]), np.float32)
        kept = np.searchsorted(self.viewpoints, known)
        chance[np.isin(viewpoints, known)] = self.chance.reshape(-1, *shape[1:])[kept]
        fields[np.isin(viewpoints, known)] = self.fields[kept]
        if len(new):
            chance[np.isin(viewpoints, new)] = _chances(space, self.sensor, self.cells, new, kinds)
            fields[np.isin(viewpoints, new)] = distance_fields(space, new)
        return _views(
            space, self.sensor, self.motion, self.cells, viewpoints, kinds, chance, fields
        )

    @property
    def kinds(self) -> list[tuple[float, float]]:
        """(heading, extent) [rad] of the looks from every position."""
        one = self.viewpoint == self.viewpoint[0]
        return list(zip(self.heading[one].tolist(), self.extent[one].tolist(), strict=True))

    def starts(self, views: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Headings [rad] at the two ends of each sweep; the robot begins at the nearer one."""
        number = np.asarray(views, np.intp)
        half = np.maximum(self.extent[number] - self.sensor.field_of_view, 0.0) / 2
        return self.heading[number] - half, self.heading[number] + half


def candidate_views(
    space: FreeSpace,
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    *,
    cells: Cells | None = None,
    viewpoints: Cells | None = None,
    kinds: Sequence[tuple[float, float]] | None = None,
) -> CandidateViews:
    """Views from `viewpoints` (default: `covering_viewpoints`): pictures, sweeps, eight headings.

    Or of other `kinds`: (heading, extent) [rad] of the looks from every position.
    """
    sensor, motion = sensor or Sensor(), motion or Motion()
    cells = belief_cells(space) if cells is None else cells
    if viewpoints is None:
        viewpoints = covering_viewpoints(space, sensor.far, near=sensor.near)
    kinds = kinds or _kinds(sensor.field_of_view)
    chance = _chances(space, sensor, cells, viewpoints, kinds)
    fields = distance_fields(space, viewpoints)
    return _views(space, sensor, motion, cells, viewpoints, kinds, chance, fields)


def _chances(
    space: FreeSpace,
    sensor: Sensor,
    cells: Cells,
    viewpoints: Cells,
    kinds: Sequence[tuple[float, float]],
) -> NDArray[np.float32]:
    """(s, k, c) what views of `kinds` from each of `viewpoints` show."""
    chance = np.zeros((len(viewpoints), len(kinds), len(cells)), np.float32)
    for rows, viewpoint in zip(chance, viewpoints, strict=True):
        _fill(rows, space, sensor, cells, int(viewpoint), kinds)
    return chance


def _views(
    space: FreeSpace,
    sensor: Sensor,
    motion: Motion,
    cells: Cells,
    viewpoints: Cells,
    kinds: Sequence[tuple[float, float]],
    chance: NDArray[np.float32],
    fields: NDArray[np.float32],
) -> CandidateViews:
    extent = np.tile([e for _, e in kinds], len(viewpoints))
    return CandidateViews(
        space=space,
        sensor=sensor,
        motion=motion,
        cells=cells,
        viewpoints=viewpoints,
        viewpoint=np.repeat(np.arange(len(viewpoints)), len(kinds)),
        heading=np.tile([h for h, _ in kinds], len(viewpoints)),
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
    viewpoint: int,
    kinds: Sequence[tuple[float, float]],
) -> None:
    seen, offset = visible_cells(space, viewpoint, sensor.far)
    at = np.searchsorted(cells, seen)
    kept = (at < len(cells)) & (cells[np.minimum(at, len(cells) - 1)] == seen)
    at, offset = at[kept], offset[kept]
    chance = sensor.chance(np.hypot(offset[:, 0], offset[:, 1]))
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    for row, (heading, extent) in zip(rows, kinds, strict=True):
        inside = angle_between(bearing, heading) <= extent / 2 + 1e-9
        row[at[inside]] = chance[inside]


def floor_in_view(
    space: FreeSpace, sensor: Sensor, cell: int, heading: float, extent: float
) -> FloorView:
    """Every cell, of belief or not, that a sweep of `extent` [rad] about `heading` shows."""
    seen, offset = visible_cells(space, cell, sensor.far)
    metres = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    shown = (metres >= sensor.near) & (angle_between(bearing, heading) <= extent / 2 + 1e-9)
    return FloorView(space.centres(seen[shown]), metres[shown], space.cell)


def picture_chance(views: CandidateViews, cell: int, heading: float) -> NDArray[np.float32]:
    """(c,) chance to detect in one picture from `cell` towards `heading`, e.g. on the way."""
    row = np.zeros((1, len(views.cells)), np.float32)
    kind = [(heading, views.sensor.field_of_view)]
    _fill(row, views.space, views.sensor, views.cells, cell, kind)
    return np.array(row[0])
