"""Thing finder: what stands out of its surroundings in several views and is still there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.surface.voxels import Surface, keys_of
from kg.model.oriented_boxes import OrientedBox, along, along_nearest_axes
from kg.model.records import ObjectRecord
from mapping.objects.extents.walls import Walls
from mapping.things.agreement import AgreedPart, SeenPart, agreed_parts
from mapping.things.view_parts import MAX_LENGTH, parts_of
from perception.depth_image import DepthImage
from perception.frames import Frame

MIN_LENGTH: Final = 0.08  # [m] longest side of a thing, at least; at most MAX_LENGTH
MAX_PARTS: Final = 20_000  # that are kept; those of the oldest views are dropped
_THERE: Final = 0.3  # share of the voxels of a thing that the surface still has, at least
_COVERED: Final = 0.5  # share of its points in the box of a named object, from which on it is that
_AROUND: Final = 0.05  # [m] around the box of a named object
_SURE: Final = 0.5  # existence from which on a named object hides a thing

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FoundThing:
    """A thing that stands out of its surroundings."""

    box: OrientedBox
    points: Floats  # (n, 3) [m] of its surface
    views: int  # that show it, from different viewpoints
    last_seen: float  # [s]


class ThingFinder:
    """Parts of the views of one recording, and the things that they agree on."""

    def __init__(self) -> None:
        self._seen, self._views = list[SeenPart](), 0

    def add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        """Add the parts of a view, without what is in the boxes xyxy [px] of `people`."""
        depth = frame.depth.copy()
        for x1, y1, x2, y2 in np.maximum(people, 0).astype(np.intp).tolist():
            depth[y1 : y2 + 1, x1 : x2 + 1] = 0
        parts = parts_of(DepthImage.of(depth, frame.K, frame.T_map_cam))
        self._seen += [SeenPart(part, self._views, frame.stamp) for part in parts]
        self._views += 1
        del self._seen[:-MAX_PARTS]

    def found(self, surface: Surface) -> list[FoundThing]:
        """Things of 8 cm to 1 m that `surface` still shows."""
        if not len(surface):
            return []
        walls = Walls.of(surface.points.astype(np.float64), surface.size)
        yaw = 0.0 if walls is None else walls.yaw
        there = np.sort(keys_of(_cells(surface.points, surface.size).T))
        found = list[FoundThing]()
        for agreed in agreed_parts(self._seen, yaw):
            points = np.concatenate([one.part.points for one in agreed.seen])
            cells, first = np.unique(_cells(points, surface.size), axis=0, return_index=True)
            longest = (agreed.high - agreed.low).max()
            if MIN_LENGTH <= longest <= MAX_LENGTH and _share(cells, there) >= _THERE:
                found.append(_thing(agreed, points[first].astype(np.float64), yaw))
        return found


def _cells(points: NDArray[np.float32], size: float) -> NDArray[np.int64]:
    cells: NDArray[np.int64] = np.floor(points / size).astype(np.int64)
    return cells


def _share(cells: NDArray[np.int64], there: NDArray[np.int64]) -> float:
    """Share of `cells` (n, 3) that are among `there`, sorted keys of voxels."""
    keys = keys_of(cells.T)
    at = np.searchsorted(there, keys)
    return float((there[np.minimum(at, len(there) - 1)] == keys).mean())


def _thing(agreed: AgreedPart, points: Floats, yaw: float) -> FoundThing:
    size = agreed.high - agreed.low
    x, y, turn = along_nearest_axes(float(size[0]), float(size[1]), yaw)
    centre = along((agreed.low + agreed.high) / 2, -yaw)
    box = OrientedBox(centre, np.array([x, y, size[2]]), float(turn))
    return FoundThing(box, points, len(agreed.seen), max(one.stamp for one in agreed.seen))


def is_covered(points: Floats, named: Sequence[ObjectRecord]) -> bool:
    """Whether most points (n, 3) [m] of a thing lie in the box of a named object."""
    for record in named:
        if record.extent is None or record.existence < _SURE:
            continue
        relative = np.abs(along(points - record.p_map, record.yaw))
        if (relative <= record.extent / 2 + _AROUND).all(1).mean() > _COVERED:
            return True
    return False
