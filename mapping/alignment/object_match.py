"""Object match: how well a recording's objects lie on a map's objects of the same categories."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import ObjectRecord

Floats = NDArray[np.float64]

_SPREAD: Final = 0.2  # [m] standard deviation between two mappings of one object
_MIN_EXISTENCE: Final = 0.3  # existence
_PAIR: Final = 0.6  # [m] between two objects that give a heading
_PAIRS: Final = 3000  # of two objects here and two there, that are tried


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Objects as landmarks: parallel arrays of length n."""

    category: tuple[str, ...]  # IRIs
    p_map: Floats  # (n, 3) [m]
    existence: Floats  # (n,)

    def __len__(self) -> int:
        return len(self.category)


def landmarks(objects: Sequence[ObjectRecord]) -> Landmarks:
    """Landmarks of the objects that probably exist."""
    kept = [o for o in objects if o.existence >= _MIN_EXISTENCE]
    return Landmarks(
        tuple(o.category for o in kept),
        np.array([o.p_map for o in kept]).reshape(-1, 3),
        np.array([o.existence for o in kept]),
    )


class ObjectMatcher:
    """Compares landmarks `source` with landmarks `target`."""

    def __init__(self, source: Landmarks, target: Landmarks) -> None:
        self._source, self._target = source, target
        same = np.array([[a == b for b in target.category] for a in source.category], bool)
        self._same = same.reshape(len(source), len(target))
        # an object of a frequent category is weak evidence
        self._weight = (
            self._same * np.sqrt(source.existence[:, None] * target.existence[None, :])
        ) / np.sqrt(np.maximum(self._same.sum(axis=1, keepdims=True), 1))

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
        moved = self._source.p_map @ T[:3, :3].T + T[:3, 3]
        return moved[kept], self._target.p_map[columns[kept]]

    def candidates(self) -> Iterator[Floats]:
        """Transforms (4, 4) about z that lay two objects on two of their categories."""
        a, b = self._source.p_map, self._target.p_map
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
        moved = self._source.p_map @ T[:3, :3].T + T[:3, 3]
        apart = np.linalg.norm(moved[:, None] - self._target.p_map[None], axis=2)
        return np.asarray(np.exp(-0.5 * (apart / _SPREAD) ** 2))


def about_z(yaw: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Floats:
    """Transform (4, 4): a turn by `yaw` [rad] about z, then a shift [m]."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = x, y, z
    return T
