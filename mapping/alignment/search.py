"""Alignment: the transform about the vertical that lays one mapping of a place on another.

Floors are compared at every turn and shift (correlative scan matching: Olson, ICRA 2009; here by
FFT), and pairs of objects of one category give further candidates. The best of them are refined on
floor and objects together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.alignment.floor_match import FloorField, FloorMatch, FloorPoints, floor_field
from mapping.alignment.object_match import Landmarks, ObjectMatcher, about_z

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
        objects: Landmarks,
        target_objects: Landmarks,
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
