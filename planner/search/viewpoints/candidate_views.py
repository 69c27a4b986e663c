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


_MAX_CELLS: Final = 10_000  # of a belief, approximately


def belief_cells(space: FreeSpace) -> Cells:
    """Cells of the belief: all of the floor, or a regular sample with a cell of every room."""
    floor = space.inside()
    step = int(np.ceil(np.sqrt(len(floor) / _MAX_CELLS)))
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
    """Number of the square with sides of `SQUARE` metres that contains floor cell `cell`."""
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
    viewpoint: NDArray[np.intp]  # (n,) number of each view's viewpoint
    heading: NDArray[np.float64]  # (n,) [rad] the middle of its sweep
    extent: NDArray[np.float64]  # (n,) [rad] seen in one sweep
    seconds: NDArray[np.float64]  # (n,) [s] of the sweep, without the turn before it
    chance: NDArray[np.float32]  # (n, c) chance to detect an object in each cell
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
        known = np.isin(viewpoints, self.viewpoints) & (space is self.space)
        shape = (len(viewpoints), len(kinds), len(self.cells))
        chance = np.zeros(shape, np.float32)
        fields = np.zeros((len(viewpoints), *self.fields.shape[1:]), np.float32)
        kept = np.searchsorted(self.viewpoints, viewpoints[known])
        chance[known] = self.chance.reshape(-1, *shape[1:])[kept]
        fields[known] = self.fields[kept]
        if not known.all():
            new = viewpoints[~known]
            chance[~known] = _chances(space, self.sensor, self.cells, new, kinds)
            fields[~known] = distance_fields(space, new)
        return _views(
            space, self.sensor, self.motion, self.cells, viewpoints, kinds, chance, fields
        )

    @property
    def kinds(self) -> list[tuple[float, float]]:
        """(heading, extent) [rad] of the views from every viewpoint."""
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
) -> CandidateViews:
    """Pictures and sweeps in eight headings, and whole turns, from each of `viewpoints`.

    Args:
        space: The floor.
        sensor: Sensor model; the thesis' by default.
        motion: Motion model; the thesis' by default.
        cells: Cells of the belief; by default `belief_cells`.
        viewpoints: Floor cells; by default `covering_viewpoints`.
    """
    sensor, motion = sensor or Sensor(), motion or Motion()
    cells = belief_cells(space) if cells is None else cells
    if viewpoints is None:
        viewpoints = covering_viewpoints(space, sensor.far, near=sensor.near)
    kinds = _kinds(sensor.field_of_view)
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
    """(s, k, c) chance to detect an object in each cell by views of `kinds` from `viewpoints`."""
    chance = np.zeros((len(viewpoints), len(kinds), len(cells)), np.float32)
    for rows, viewpoint in zip(chance, viewpoints, strict=True):
        seen, offset = visible_cells(space, int(viewpoint), sensor.far)
        at = np.searchsorted(cells, seen)
        kept = (at < len(cells)) & (cells[np.minimum(at, len(cells) - 1)] == seen)
        at, offset = at[kept], offset[kept]
        of_cell = sensor.chance(np.hypot(offset[:, 0], offset[:, 1]))
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        for row, (heading, extent) in zip(rows, kinds, strict=True):
            inside = angle_between(bearing, heading) <= extent / 2 + 1e-9
            row[at[inside]] = of_cell[inside]
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
    """(heading, extent) [rad] of the views from one viewpoint."""
    headings = np.arange(HEADINGS) * 2 * np.pi / HEADINGS - np.pi
    sweeps = sorted({max(extent, field_of_view) for extent in EXTENTS})
    whole = 2 * np.pi - 1e-9
    found = [(float(h), e) for e in sweeps if e < whole for h in headings]
    return [*found, (0.0, 2 * np.pi)]


def floor_in_view(
    space: FreeSpace, sensor: Sensor, cell: int, heading: float, extent: float
) -> FloorView:
    """The floor that a sweep of `extent` [rad] about `heading` [rad] from `cell` shows."""
    seen, offset = visible_cells(space, cell, sensor.far)
    metres = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    shown = (metres >= sensor.near) & (angle_between(bearing, heading) <= extent / 2 + 1e-9)
    return FloorView(space.centres(seen[shown]), metres[shown], space.cell)


def sweep_chance(
    views: CandidateViews, cell: int, heading: float, extent: float
) -> NDArray[np.float32]:
    """(c,) chance to detect an object in each cell by a sweep of `extent` [rad] about `heading`."""
    viewpoint, kinds = np.array([cell], np.intp), [(heading, extent)]
    return _chances(views.space, views.sensor, views.cells, viewpoint, kinds).reshape(-1)
