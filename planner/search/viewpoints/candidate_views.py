"""Candidate views: viewpoints that cover the floor, headings, and the cells that each view shows.

A view is a sweep of the camera about a heading, from a viewpoint. Its footprint is the probability
to detect an object in each cell of the belief; walls block it. Footprints are sparse: a view shows
some hundred of the cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapping.occupancy.mapped_floor import FloorView
from planner.freespace.geodesic import ShortestWays
from planner.freespace.grid import Cells, FreeSpace, visible_cells
from planner.search.viewpoints.covering_viewpoints import covering_viewpoints
from planner.settings import LOOK_AROUND, SPEED


@dataclass(frozen=True, slots=True)
class Sensor:
    """Sensor model of an RGB-D camera with a detector.

    A view detects an object within its range with the probability `recall`. A second view from the
    same square keeps the share 1 - `rho` of its probability, since misses are correlated. Raises
    ValueError for impossible values.
    """

    near: float = 0.8  # [m] depth gate, thesis section 3.2.2
    far: float = 4.6  # [m] depth gate, thesis section 3.2.2
    field_of_view: float = 1.0123  # [rad] 58 degrees, across
    recall: float = 0.7  # probability to detect an object in view, from near
    rho: float = 0.8  # correlation of repeated views

    def __post_init__(self) -> None:
        if not 0 <= self.near < self.far or not 0 < self.field_of_view <= 2 * np.pi:
            raise ValueError(f"needs 0 <= near < far and a field of view in 0..2 pi, got {self}")
        if not 0 < self.recall <= 1 or not 0 <= self.rho <= 1:
            raise ValueError(f"recall and rho must lie in 0..1, got {self}")

    def chance(self, metres: ArrayLike) -> NDArray[np.float64]:
        """Chance to detect at each distance [m]."""
        d = np.asarray(metres, np.float64)
        return np.where((d >= self.near) & (d <= self.far), self.recall, 0.0)


@dataclass(frozen=True, slots=True)
class Motion:
    """Time that moving and taking views cost. Defaults are those of the thesis' robot."""

    speed: float = SPEED  # [m/s]
    turn_rate: float = 2 * np.pi / LOOK_AROUND  # [rad/s]: a whole turn is the thesis' look
    picture: float = 1.0  # [s] to stand still for one picture

    def __post_init__(self) -> None:
        if not self.speed > 0 or not self.turn_rate > 0 or not self.picture >= 0:
            raise ValueError(f"speed and turn rate must be > 0 and picture >= 0, got {self}")

    def sweep_seconds(self, extent: ArrayLike, field_of_view: float) -> NDArray[np.float64]:
        """[s] of a sweep over `extent` [rad]: a picture, and the turn beyond its field of view."""
        turned = np.maximum(np.asarray(extent, np.float64) - field_of_view, 0.0)
        whole = np.asarray(extent) >= 2 * np.pi - 1e-9
        return self.picture + np.where(whole, 2 * np.pi, turned) / self.turn_rate


@dataclass(frozen=True, slots=True)
class Sweep:
    """Sweep of the camera: the robot turns on the spot and looks all the way."""

    start: float  # [rad] heading to begin with
    turn: float  # [rad] to turn from there, to the left
    middle: float  # [rad] heading in the middle of all that is in view
    extent: float  # [rad] in view altogether


def sweep_over(at: float, heading: float, extent: float, field_of_view: float) -> Sweep:
    """The shortest sweep that shows `extent` [rad] about `heading`, for a robot that heads `at`.

    It begins at once where the robot has to turn there anyway, and shows what it turns past.
    """
    whole = 2 * np.pi - 1e-9
    if extent >= whole:
        return Sweep(at, 2 * np.pi, heading, extent)
    half = max(extent - field_of_view, 0.0) / 2
    off = float(np.remainder(heading - at + np.pi, 2 * np.pi) - np.pi)
    side = -1.0 if off < 0 else 1.0
    if abs(off) <= half:  # it stands within the sweep: from the nearer end to the other
        return Sweep(heading - side * half, side * 2 * half, heading, extent)
    turn = side * (abs(off) + half)
    return Sweep(at, turn, at + turn / 2, min(abs(turn) + field_of_view, whole))


def angle_between(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """[rad] the smaller angle between headings, 0..pi."""
    off = (np.asarray(a) - np.asarray(b) + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(np.abs(off), np.float64)


_Cell = TypeVar("_Cell", int, NDArray[np.intp])

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


def square(space: FreeSpace, cell: _Cell) -> _Cell:
    """Number of the square with sides of `SQUARE` metres that contains floor `cell`, or of each."""
    side, columns = max(1, round(SQUARE / space.cell)), space.shape[1]
    return cell // columns // side * columns + cell % columns // side


@dataclass(frozen=True, slots=True, eq=False)
class DetectionMatrix:
    """(n, c) chances of n views to detect an object in c cells; compressed sparse rows."""

    starts: NDArray[np.intp]  # (n + 1,) of each row in `cell` and `value`
    cell: NDArray[np.intp]  # (m,) columns
    value: NDArray[np.float32]  # (m,) above 0
    columns: int  # c

    def __len__(self) -> int:
        """Number of views."""
        return len(self.starts) - 1

    def __getitem__(self, view: int) -> NDArray[np.float32]:
        """(c,) the row of a view."""
        row = np.zeros(self.columns, np.float32)
        cell, value = self.shown(view)
        row[cell] = value
        return row

    def __matmul__(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) sums of `weight` (c,) by the chances."""
        return self.product(weight)

    def product(
        self, weight: NDArray[np.float64], value: NDArray[np.float32] | None = None
    ) -> NDArray[np.float64]:
        """As ``self @ weight``, with other chances `value` (m,) in the place of its own."""
        found = np.zeros(len(self))
        held = np.diff(self.starts) > 0
        if held.any():
            share = (self.value if value is None else value) * weight[self.cell]
            found[held] = np.add.reduceat(share, self.starts[:-1][held])
        return found

    def shown(self, view: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Cells (k,) that a view shows, and the chances (k,)."""
        part = slice(self.starts[view], self.starts[view + 1])
        return self.cell[part], self.value[part]

    def rows(self, views: NDArray[np.intp]) -> DetectionMatrix:
        """The matrix of some `views` (k,)."""
        length = np.diff(self.starts)[views]
        starts = np.concatenate([[0], np.cumsum(length)]).astype(np.intp)
        at = np.repeat(self.starts[views] - starts[:-1], length) + np.arange(starts[-1])
        return DetectionMatrix(starts, self.cell[at], self.value[at], self.columns)

    def any(self, views: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
        """(c,) cells that any of `views` (n,) shows, by default of all."""
        shown = np.zeros(self.columns, np.bool_)
        shown[self.cell if views is None else self.cell[views.repeat(np.diff(self.starts))]] = True
        return shown

    def greatest(self) -> NDArray[np.float32]:
        """(c,) the greatest chance of any view in each cell."""
        most = np.zeros(self.columns, np.float32)
        np.maximum.at(most, self.cell, self.value)
        return most


def detection_matrix(
    space: FreeSpace,
    sensor: Sensor,
    cells: Cells,
    viewpoints: Cells,
    kinds: Sequence[tuple[float, float]],
    proven: Cells,
) -> DetectionMatrix:
    """Chances in `cells` by views of `kinds` (heading, extent [rad]) from each viewpoint in turn.

    `proven` (m, 2) has pairs of a viewpoint and a cell that a camera showed from there.
    """
    heading, extent = np.array(kinds).reshape(-1, 2).T
    lengths, shown = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    chances = [np.zeros(0, np.float32)]
    for viewpoint in viewpoints:
        seen, offset = visible_cells(space, int(viewpoint), sensor.far)
        at = np.searchsorted(cells, seen)
        kept = (at < len(cells)) & (cells[np.minimum(at, len(cells) - 1)] == seen)
        also = np.unique(proven[proven[:, 0] == viewpoint, 1])
        kept &= ~np.isin(seen, also)
        at, offset = at[kept], offset[kept]
        metres = np.hypot(offset[:, 0], offset[:, 1])
        if len(also):
            there = space.centres(also) - space.centres([viewpoint])
            at, offset = np.append(at, np.searchsorted(cells, also)), np.vstack([offset, there])
            metres = np.append(metres, np.clip(np.hypot(*there.T), sensor.near, sensor.far))
        chance = sensor.chance(metres).astype(np.float32)
        off = (np.arctan2(offset[:, 1], offset[:, 0]) - heading[:, None] + np.pi) % (2 * np.pi)
        inside = (np.abs(off - np.pi) <= extent[:, None] / 2 + 1e-9) & (chance > 0)
        number = np.nonzero(inside)[1]
        lengths.append(inside.sum(axis=1))
        shown.append(at[number])
        chances.append(chance[number])
    starts = np.concatenate([[0], np.cumsum(np.concatenate(lengths))]).astype(np.intp)
    return DetectionMatrix(starts, np.concatenate(shown), np.concatenate(chances), len(cells))


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
    chance: DetectionMatrix  # (n, c) chance to detect an object in each cell
    ways: ShortestWays  # between viewpoints
    proven: Cells  # (m, 2) a floor cell, and a cell of the belief that a camera showed from there

    def with_viewpoints(self, space: FreeSpace, viewpoints: Cells) -> CandidateViews:
        """Views over the same cells from other `viewpoints`, on a floor that may have changed."""
        return _views(
            space, self.sensor, self.motion, self.cells, viewpoints, self.kinds, self.proven
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
    proven: Cells | None = None,
) -> CandidateViews:
    """Pictures and sweeps in eight headings, and whole turns, from each of `viewpoints`.

    Args:
        space: The floor.
        sensor: Sensor model; the thesis' by default.
        motion: Motion model; the thesis' by default.
        cells: Cells of the belief; by default `belief_cells`.
        viewpoints: Floor cells; by default `covering_viewpoints`.
        proven: (m, 2) pairs of a floor cell and a cell of the belief that a camera showed from
            there, whatever the floor plan says.
    """
    sensor, motion = sensor or Sensor(), motion or Motion()
    cells = belief_cells(space) if cells is None else cells
    if viewpoints is None:
        viewpoints = covering_viewpoints(space, sensor.far, near=sensor.near)
    kinds = _kinds(sensor.field_of_view)
    proven = np.zeros((0, 2), np.intp) if proven is None else proven
    return _views(space, sensor, motion, cells, viewpoints, kinds, proven)


def _views(
    space: FreeSpace,
    sensor: Sensor,
    motion: Motion,
    cells: Cells,
    viewpoints: Cells,
    kinds: Sequence[tuple[float, float]],
    proven: Cells,
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
        chance=detection_matrix(space, sensor, cells, viewpoints, kinds, proven),
        ways=ShortestWays(space, viewpoints),
        proven=proven,
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
    made = detection_matrix(
        views.space,
        views.sensor,
        views.cells,
        np.array([cell], np.intp),
        [(heading, extent)],
        views.proven,
    )
    return made[0]
