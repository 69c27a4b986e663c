"""Floor match: how well a recording's floor lies on a map's floor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import FREE, LOW, TALL, FloorTile
from mapping.occupancy.depth_projection import floor_evidence, frame_points
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import Key, OccupancyTile, States, tile_evidence
from perception.binary_masks import with_neighbours
from perception.frames import Frame

Floats = NDArray[np.float64]

_NEAR: Final = (1.0, 0.8, 0.3)  # worth of an obstacle that lies 0, 1 or 2 cells from an obstacle
_THROUGH: Final = -1.0  # of one that lies on free floor
_AGREED: Final = 0.15  # of free floor on free floor
_BLOCKED: Final = -0.5  # of free floor on an obstacle
_MIN_OBSTACLES: Final = 150  # judged obstacles, and ...
_SHARE: Final = 0.3  # ... of all obstacles, to conclude anything
_MARGIN: Final = 4  # cells around the map's


@dataclass(frozen=True, slots=True, eq=False)
class FloorPoints:
    """Centres (n, 2) [m] of the cells of a floor, free ones and obstacles."""

    free: Floats
    obstacles: Floats

    def moved(self, T: Floats) -> FloorPoints:
        """The same by a transform (4, 4) about z."""
        R, t = T[:2, :2].T, T[:2, 3]
        return FloorPoints(self.free @ R + t, self.obstacles @ R + t)


@dataclass(frozen=True, slots=True)
class FloorMatch:
    """Match of one floor laid on another."""

    score: float  # sum of the worth of all cells
    known: float  # sum of the worth of those where the map knows the floor
    near: int  # cells with an obstacle that lie on an obstacle of the map, or free floor beside it
    through: int  # cells with an obstacle that lie on other free floor
    cells: int  # with an obstacle, all

    @property
    def judged(self) -> int:
        """Cells with an obstacle that the map knows something of."""
        return self.near + self.through

    @property
    def share(self) -> float:
        """Share of judged obstacles that lie near an obstacle of the map; 0 without any."""
        return self.near / self.judged if self.judged else 0.0

    @property
    def quality(self) -> float:
        """Worth of a judged obstacle, with the free floor's: above 0.9 where floors are one."""
        return self.known / self.judged if self.judged else 0.0

    def enough(self) -> bool:
        """Whether enough is judged to conclude anything."""
        return self.judged >= _MIN_OBSTACLES and self.judged >= _SHARE * self.cells


@dataclass(frozen=True, slots=True, eq=False)
class FloorField:
    """Score that each cell of a map's floor gives to an obstacle, and to free floor, laid on it."""

    origin: Floats  # (2,) [m] corner of cell (0, 0)
    cell: float  # [m]
    obstacle: Floats  # (nx, ny)
    free: Floats  # (nx, ny)
    known: NDArray[np.bool_]  # (nx, ny) cells that are not unknown

    def match(self, points: FloorPoints) -> FloorMatch:
        """Match of `points` laid on this floor."""
        worth = self._at(self.obstacle, points.obstacles)
        known = self._at(self.known, points.obstacles) > 0
        near, through = int((known & (worth > 0)).sum()), int((worth < 0).sum())
        free = float(self._at(self.free, points.free).sum())
        sums = float(worth.sum()) + free, float(worth[known].sum()) + free
        return FloorMatch(*sums, near, through, len(points.obstacles))

    def _at(self, field: Floats | NDArray[np.bool_], xy: Floats) -> Floats:
        cells = np.floor((xy - self.origin) / self.cell).astype(np.intp)
        inside = ((cells >= 0) & (cells < field.shape)).all(axis=1)
        found = np.zeros(len(xy))
        found[inside] = field[cells[inside, 0], cells[inside, 1]]
        return found


def floor_tiles(frames: Iterable[Frame]) -> dict[Key, States]:
    """Tiles of the floor at height 0 that `frames` show."""
    s = OccupancySettings()
    tiles = dict[Key, OccupancyTile]()
    for frame in frames:
        points = frame_points(frame.depth, frame.K, frame.T_map_cam, s)
        observed = floor_evidence(points, frame.T_map_cam[:3, 3], 0.0, s)
        for key, evidence in tile_evidence(observed, s):
            tiles.setdefault(key, OccupancyTile(s)).add(evidence, frame.stamp, s)
    return {key: tile.states(s) for key, tile in tiles.items()}


def floor_of_frames(frames: Iterable[Frame]) -> FloorPoints:
    """Floor at height 0 that `frames` show."""
    return _points(floor_tiles(frames), OccupancySettings().cell)


def floor_of_map(tiles: Iterable[FloorTile]) -> FloorPoints:
    """Floor of storey 0 of a map."""
    held = [tile for tile in tiles if tile.storey == 0]
    if not held:
        return _points({}, 1.0)
    return _points({(t.column, t.row): t.cells for t in held}, held[0].resolution)


def floor_field(points: FloorPoints, cell: float) -> FloorField | None:
    """Field of a map's floor with cells of `cell` [m]; None of an empty floor."""
    both = np.concatenate([points.free, points.obstacles])
    if not len(both):
        return None
    origin = (np.floor(both.min(axis=0) / cell) - _MARGIN) * cell
    size = np.ceil((both.max(axis=0) - origin) / cell).astype(int) + _MARGIN
    free, solid = np.zeros(size, bool), np.zeros(size, bool)
    for mask, xy in ((free, points.free), (solid, points.obstacles)):
        at = np.floor((xy - origin) / cell).astype(int)
        mask[at[:, 0], at[:, 1]] = True
    known = free | solid
    free &= ~solid
    obstacle = np.where(free, _THROUGH, 0.0)
    reached = solid
    for worth in _NEAR:
        obstacle[reached & (obstacle <= 0)] = worth
        reached = with_neighbours(reached)
    of_free = np.where(free, _AGREED, np.where(solid, _BLOCKED, 0.0))
    return FloorField(origin, cell, obstacle, of_free, known)


def _points(tiles: Mapping[Key, States], cell: float) -> FloorPoints:
    found: dict[bool, list[Floats]] = {True: [np.zeros((0, 2))], False: [np.zeros((0, 2))]}
    for (column, row), states in tiles.items():
        corner = np.array([column, row]) * len(states) * cell
        for free, wanted in ((True, (FREE,)), (False, (LOW, TALL))):
            at = np.argwhere(np.isin(states, wanted))
            found[free].append(corner + (at + 0.5) * cell)
    return FloorPoints(np.concatenate(found[True]), np.concatenate(found[False]))
