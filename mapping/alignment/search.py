"""Alignment: the transform about the vertical that lays one mapping of a place on another.

Floors are compared at every turn and shift (correlative scan matching: Olson, ICRA 2009; here by
FFT), and pairs of objects of one category give further candidates. The best of them are refined on
floor and objects together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import FREE, LOW, TALL, FloorTile, ObjectRecord
from mapping.occupancy.depth_projection import floor_evidence, frame_points
from mapping.occupancy.occupancy_settings import OccupancySettings
from mapping.occupancy.tiles import Key, OccupancyTile, States, tile_evidence
from perception.binary_masks import with_neighbours
from perception.frames import Frame

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


_SPREAD: Final = 0.2  # [m] standard deviation between two mappings of one object
_MIN_EXISTENCE: Final = 0.3  # of an object that is a landmark
_PAIR: Final = 0.6  # [m] between two objects that give a heading
_PAIRS: Final = 3000  # of two objects here and two there, that are tried


class ObjectMatcher:
    """Compares the objects `source` with the objects `target`, of those that may be there."""

    def __init__(self, source: Sequence[ObjectRecord], target: Sequence[ObjectRecord]) -> None:
        source, target = (
            [one for one in objects if one.existence >= _MIN_EXISTENCE]
            for objects in (source, target)
        )
        self._source, self._target = (
            np.array([one.p_map for one in objects]).reshape(-1, 3) for objects in (source, target)
        )
        same = np.array([[a.category == b.category for b in target] for a in source], bool)
        self._same = same.reshape(len(source), len(target))
        # an object of a frequent category is weak evidence
        existence = np.outer([a.existence for a in source], [b.existence for b in target])
        often = np.maximum(self._same.sum(axis=1, keepdims=True), 1)
        self._weight = self._same * np.sqrt(existence) / np.sqrt(often)

    def score(self, T: Floats) -> float:
        """Matches by the transform (4, 4), each up to 1, summed."""
        if not self._same.any():
            return 0.0
        return float((self._weight * self._closeness(T)).max(axis=1).sum())

    def pairs(self, T: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3) [m] of matched objects: of the source, moved by `T`, and of the map."""
        if not self._same.any():
            return np.zeros((0, 3)), np.zeros((0, 3))
        near = self._weight * self._closeness(T)
        rows, columns = np.arange(len(near)), near.argmax(axis=1)
        # one to one: the best source of each map object
        best = near.argmax(axis=0)
        kept = (near[rows, columns] > 0.05) & (best[columns] == rows)
        moved = self._source @ T[:3, :3].T + T[:3, 3]
        return moved[kept], self._target[columns[kept]]

    def candidates(self) -> Iterator[Floats]:
        """Transforms (4, 4) about z that lay two objects on two of their categories."""
        a, b = self._source, self._target
        rows, columns = np.nonzero(self._same)
        if len(rows) < 2:
            return
        first, second = np.triu_indices(len(rows), 1)
        if len(first) > 40 * _PAIRS:
            chosen = np.random.default_rng(0).choice(len(first), 40 * _PAIRS, replace=False)
            first, second = first[chosen], second[chosen]
        here = a[rows[second]] - a[rows[first]]
        there = b[columns[second]] - b[columns[first]]
        level_here = np.hypot(here[:, 0], here[:, 1])
        level_there = np.hypot(there[:, 0], there[:, 1])
        fits = (
            (level_here > _PAIR)
            & (np.abs(level_here - level_there) < _SPREAD)
            & (np.abs(here[:, 2] - there[:, 2]) < _SPREAD)
        )
        for k in np.flatnonzero(fits)[:_PAIRS]:
            yaw = np.arctan2(there[k, 1], there[k, 0]) - np.arctan2(here[k, 1], here[k, 0])
            T = about_z(float(yaw))
            ends = [first[k], second[k]]
            T[:3, 3] = (b[columns[ends]] - a[rows[ends]] @ T[:3, :3].T).mean(axis=0)
            yield T

    def _closeness(self, T: Floats) -> Floats:
        moved = self._source @ T[:3, :3].T + T[:3, 3]
        apart = np.linalg.norm(moved[:, None] - self._target[None], axis=2)
        return np.asarray(np.exp(-0.5 * (apart / _SPREAD) ** 2))


def about_z(yaw: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Floats:
    """Transform (4, 4): a turn by `yaw` [rad] about z, then a shift [m]."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = x, y, z
    return T


Floats = NDArray[np.float64]

_COARSE: Final = 0.1  # [m] cells of the search
_FINE: Final = 0.05  # [m] cells of the refinement
_TURN: Final = np.radians(3.0)  # [rad] step of the search
_PEAKS: Final = 4  # best shifts of each turn, which become candidates
_KEPT: Final = 40  # candidates that are refined
_OBJECT: Final = 150.0  # cells of floor that count as much as one matched object
_SAME: Final = 0.4  # [m] candidates that differ by less, in shift and turn, are one
_SAME_TURN: Final = np.radians(12.0)  # [rad] the same for the turn
_STEPS: Final = ((0.1, 2.0), (0.05, 1.0), (0.025, 0.5), (0.0125, 0.25))  # [m], [degrees]
_POINTS: Final = 4000  # points of the floor that candidates are compared by


@dataclass(frozen=True, slots=True)
class Alignment:
    """The best transform found, and how much better it is than any other."""

    T: Floats  # (4, 4) source to target
    floor: FloorMatch
    objects: int  # source objects that lie on a target object of their category
    score: float
    rival: float  # score of the best transform to another spot


class AlignmentSearch:
    """Search of the transform that lays a source's floor and objects on a target's."""

    def __init__(
        self,
        floor: FloorPoints,
        target_floor: FloorPoints,
        objects: Sequence[ObjectRecord],
        target_objects: Sequence[ObjectRecord],
    ) -> None:
        self._floor = floor
        self._few = FloorPoints(_thinned(floor.free), _thinned(floor.obstacles))
        # each remaining point stands for several
        self._scale = len(floor.obstacles) / max(len(self._few.obstacles), 1)
        points = np.concatenate([floor.free, floor.obstacles])
        self._centre = np.append(points.mean(axis=0) if len(points) else np.zeros(2), 0.0)
        self._coarse = floor_field(target_floor, _COARSE)
        self._fine = floor_field(target_floor, _FINE)
        self._objects = ObjectMatcher(objects, target_objects)

    def best(self) -> Alignment | None:
        """The best transform; None where there is nothing to compare."""
        tried = [*self._floor_candidates(), *self._objects.candidates()]
        worth = [self._score(T, self._coarse) for T in tried]
        refined = list[tuple[float, Floats]]()
        for index in np.argsort(worth)[::-1]:
            if len(refined) == _KEPT:
                break
            if not any(_same(tried[index], T) for _, T in refined):
                refined.append(self._refined(tried[index]))
        if not refined:
            return None
        refined.sort(key=lambda found: -found[0])
        score, T = refined[0]
        rival = max((other for other, elsewhere in refined if not _same(T, elsewhere)), default=0.0)
        moved = self._floor.moved(T)
        floor = FloorMatch(0.0, 0.0, 0, 0, 0) if self._fine is None else self._fine.match(moved)
        return Alignment(T, floor, len(self._objects.pairs(T)[0]), score, rival)

    def _score(self, T: Floats, field: FloorField | None) -> float:
        worth = _OBJECT * self._objects.score(T)
        if field is not None:
            worth += self._scale * field.match(self._few.moved(T)).score
        return worth

    def _refined(self, T: Floats) -> tuple[float, Floats]:
        """Hill climbing over shift and turn, by smaller and smaller steps."""
        score, centre = self._score(T, self._fine), self._centre
        for shift, turn in _STEPS:
            improved = True
            while improved:
                improved = False
                for dx, dy, angle in _neighbours(shift, float(np.radians(turn))):
                    moved = _turned(T, centre, angle)
                    moved[:2, 3] += dx, dy
                    worth = self._score(moved, self._fine)
                    if worth > score + 1e-9:
                        score, T, improved = worth, moved, True
        here, there = self._objects.pairs(T)
        if len(here) >= 3:
            T = T.copy()
            T[2, 3] += float(np.clip(np.median(there[:, 2] - here[:, 2]), -0.1, 0.1))
        return score, T

    def _floor_candidates(self) -> Iterator[Floats]:
        """The best shifts of each turn, by cross-correlation of the floors."""
        field = self._coarse
        if field is None or not len(self._floor.obstacles):
            return
        cell = field.cell
        points = np.concatenate([self._floor.free, self._floor.obstacles])
        side = int(np.ceil(2 * np.linalg.norm(points, axis=1).max() / cell)) + 4
        size = [int(2 ** np.ceil(np.log2(n + side))) for n in field.obstacle.shape]
        spectra = [np.fft.rfft2(f, size) for f in (field.obstacle, field.free)]
        for yaw in np.arange(0, 2 * np.pi, _TURN):
            T = about_z(float(yaw))
            turned = self._floor.moved(T)
            total = np.zeros_like(spectra[0])
            for spectrum, xy in zip(spectra, (turned.obstacles, turned.free), strict=True):
                at = np.floor(xy / cell).astype(int) + side // 2
                image = np.zeros(size)
                np.add.at(image, (at[:, 0], at[:, 1]), 1.0)
                total = total + spectrum * np.conj(np.fft.rfft2(image))
            worth = np.fft.irfft2(total, size)
            for _ in range(_PEAKS):
                i, j = np.unravel_index(int(worth.argmax()), worth.shape)
                shift = np.array([i, j])
                signed = np.where(shift >= np.array(size) - side, shift - np.array(size), shift)
                offset = field.origin + (signed + side // 2) * cell
                yield about_z(float(yaw), *offset)
                low, high = np.maximum(shift - 4, 0), shift + 5
                worth[low[0] : high[0], low[1] : high[1]] = -np.inf


def _thinned(points: Floats) -> Floats:
    return points[:: max(1, len(points) // _POINTS)]


def _neighbours(shift: float, turn: float) -> Iterator[tuple[float, float, float]]:
    for dx, dy in ((shift, 0), (-shift, 0), (0, shift), (0, -shift)):
        yield dx, dy, 0.0
    yield 0.0, 0.0, turn
    yield 0.0, 0.0, -turn


def _turned(T: Floats, centre: Floats, angle: float) -> Floats:
    """`T`, followed by a turn [rad] about the point to which `T` moves `centre` (3,)."""
    at = T[:3, :3] @ centre + T[:3, 3]
    turn = about_z(angle)
    turn[:3, 3] = at - turn[:3, :3] @ at
    return turn @ T


def _same(a: Floats, b: Floats) -> bool:
    between = np.linalg.inv(a) @ b
    turn = abs(np.arctan2(between[1, 0], between[0, 0]))
    return float(np.linalg.norm(between[:2, 3])) < _SAME and turn < _SAME_TURN
