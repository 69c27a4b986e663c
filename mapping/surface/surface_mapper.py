"""Surface mapper: the voxels that each frame shows, and those that it looks through."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import (
    LOCAL_BITS,
    MAX_VOXELS_OF_A_MAP,
    RANGE,
    SIDE,
    FrameVoxels,
    Keys,
    Surface,
    VoxelGrid,
    cells_of,
    keys_of,
    surface_of,
)
from mapping.frames.projection import to_camera
from mapping.occupancy.depth_projection import FramePoints, frame_points
from mapping.occupancy.occupancy_settings import OccupancySettings
from perception.frames import Frame

_SETTINGS: Final = replace(OccupancySettings(), columns=128)  # pixels sampled across a frame
_TURNS: Final = 8  # frames in which each chunk in view is once looked through
_MARGIN: Final = (2.0, 0.03)  # voxels, and share of its depth, that a voxel is in front at least
_AROUND: Final = 0.05  # of its side: a person's box is wider by this

Boxes = NDArray[np.float32]  # (n, 4) xyxy [px]
Floats = NDArray[np.float64]
_T = TypeVar("_T", bound=np.generic)


class SurfaceMapper:
    """Surface mapper of one recording. A map on a server keeps none: `store` is None.

    `size` [m] is the side of a new map's voxels.
    """

    def __init__(self, semantic_map: SemanticMap, size: float, recording: str) -> None:
        writable = not semantic_map.store.read_only
        self._store = semantic_map.surface_store if writable else None
        self._recording = recording
        self._grid = VoxelGrid(size) if self._store is None else self._store.begin(size)
        self._given = size
        self._frame: FrameVoxels | None = None  # not in the map yet
        self._mark = 0
        self._cameras = set[str]()  # those so far, whose frames take turns

    def add(self, frame: Frame, people: Boxes) -> None:
        """Add a frame, for `save` and `accept`; what is in the boxes of `people` is left out.

        A frame that was not accepted is forgotten.
        """
        if self._store is None:
            return
        points = frame_points(frame.depth, frame.K, frame.T_map_cam, _SETTINGS)
        step = max(1, round(frame.depth.shape[1] / _SETTINGS.columns))
        _leave_out(points, people, step)
        seen, colour = seen_voxels(points, _sampled(frame.rgb, step), self._grid.size)
        self._cameras.add(frame.camera)
        turn = self._store.frames // len(self._cameras)
        passed = passed_voxels(self._grid, frame, step, turn)
        self._frame = FrameVoxels(seen, colour, passed, frame.stamp)

    def save(self, sequence: int) -> None:
        """Store the frame beside the map, before its transaction of that number."""
        if self._store is not None and self._frame is not None:
            self._mark = sequence
            self._store.write(self._frame, self._recording, sequence)

    def accept(self) -> None:
        """Count the frame, whose transaction is in the map now."""
        if self._store is not None and self._frame is not None:
            self._store.accept(self._frame, self._recording, self._mark)
            self._frame = None

    def within(self, low: Floats, high: Floats) -> tuple[Floats, float]:
        """Centres (n, 3) [m] of the voxels between two corners (3,) [m], and their side [m]."""
        return self._grid.within(low, high), self._grid.size

    def surface(self) -> Surface:
        """All voxels that are there."""
        return surface_of(self._grid.size, *self._grid.present())

    def finish(self) -> None:
        """Write all chunks."""
        if self._store is not None:
            self._store.flush(level=6)

    @property
    def problems(self) -> tuple[str, ...]:
        """One line each: the surface is full, or has voxels of another size than given."""
        found, size = list[str](), self._grid.size
        if self._grid.full:
            found.append(
                f"surface: it is full with {MAX_VOXELS_OF_A_MAP:,} voxels, and new ones are left "
                f"out; --surface {200 * size:g} in a new map would work"
            )
        if size != self._given:
            found.append(
                f"surface: the map's voxels keep their {100 * size:g} cm, not "
                f"{100 * self._given:g}; a new map would work"
            )
        return tuple(found)


def seen_voxels(
    points: FramePoints, rgb: NDArray[np.uint8], size: float
) -> tuple[Keys, NDArray[np.uint8]]:
    """Keys (n,), sorted, of the voxels of side `size` [m] that have points, and colours (n, 3).

    `rgb` (rows, columns, 3) are the colours of `points`.
    """
    (rows, columns), known = points.depth.shape, np.flatnonzero(np.isfinite(points.depth))
    xyz = points.xyz.reshape(3, -1).take(known, axis=1)
    cells = np.floor(xyz / size).astype(np.int64)
    colours = rgb[:rows, :columns].reshape(-1, 3).take(known, axis=0)
    if np.abs(cells).max(initial=0) >= RANGE - SIDE:
        inside = (np.abs(cells) < RANGE - SIDE).all(0)
        cells, colours = cells[:, inside], colours[inside]
    keys = keys_of(cells)
    order = np.argsort(keys)
    keys, colours = keys[order], colours.take(order, axis=0)
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    if not len(starts):
        return keys, colours
    members = np.diff(starts, append=len(keys))[:, None]
    return keys[starts], (np.add.reduceat(colours, starts, dtype=np.int64) // members).astype(
        np.uint8
    )


def passed_voxels(grid: VoxelGrid, frame: Frame, step: int, turn: int) -> Keys:
    """Keys (m,), sorted, of voxels clearly in front of what `frame` measured behind them.

    Only chunks whose turn it is are looked at. A voxel counts where all of the 3 x 3 samples
    around its projection, `step` pixels apart, are deeper by the margin.
    """
    chunks = [
        key
        for key in _in_view(grid, frame)
        if (key ^ key >> 15 ^ key >> 30) % _TURNS == turn % _TURNS
    ]
    if not chunks:
        return np.empty(0, np.int64)
    parts = [(c << LOCAL_BITS) | _there(grid, c).astype(np.int64) for c in sorted(chunks)]
    keys = np.concatenate(parts)
    centres = np.asarray((cells_of(keys).T + 0.5) * grid.size, np.float64)
    p_cam = to_camera(frame.T_map_cam, centres)
    near = np.flatnonzero(p_cam[:, 2] > _SETTINGS.near / 2)
    x, y, z = p_cam[near].T
    measured = _least_around(_sampled(frame.depth, step))
    rows, columns = measured.shape
    K, first = frame.K, step // 2
    u = np.rint((x / z * K[0, 0] + K[0, 2] - first) / step)
    v = np.rint((y / z * K[1, 1] + K[1, 2] - first) / step)
    inside = (u >= 0) & (v >= 0) & (u < columns) & (v < rows)
    near, z = near[inside], z[inside]
    behind = measured[v[inside].astype(np.intp), u[inside].astype(np.intp)]
    voxels, share = _MARGIN
    passed: Keys = keys[near[behind > (1 + share) * z + voxels * grid.size]]
    return passed


def _there(grid: VoxelGrid, chunk: int) -> NDArray[np.uint32]:
    records = grid.chunks[chunk]
    local: NDArray[np.uint32] = records["local"][records["gone"] == 0]
    return local


def _in_view(grid: VoxelGrid, frame: Frame) -> list[int]:
    """Chunks that may have a part in the image and nearer than depth is used."""
    if not grid.chunks:
        return []
    chunks = np.fromiter(grid.chunks, np.int64, len(grid.chunks))
    side = SIDE * grid.size
    corner = cells_of(chunks << LOCAL_BITS).T * grid.size
    x, y, z = to_camera(frame.T_map_cam, np.asarray(corner + side / 2, np.float64)).T
    radius = side * np.sqrt(3) / 2
    rows, columns = frame.depth.shape
    wide = np.hypot(columns, frame.K[0, 0] * 2) / frame.K[0, 0] / 2
    high = np.hypot(rows, frame.K[1, 1] * 2) / frame.K[1, 1] / 2
    ahead = (z > -radius) & (z < _SETTINGS.far + radius)
    ahead &= np.abs(x) < z * columns / frame.K[0, 0] / 2 + radius * wide
    ahead &= np.abs(y) < z * rows / frame.K[1, 1] / 2 + radius * high
    return [int(key) for key in chunks[ahead]]


def _sampled(image: NDArray[_T], step: int) -> NDArray[_T]:
    """Image at the pixels that `frame_points` takes."""
    first = step // 2
    return image[first:-1:step, first:-1:step]


def _least_around(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Least depth of the 3 x 3 samples around each; 0 where one is unknown."""
    least = np.pad(np.nan_to_num(depth, nan=0.0, posinf=0.0), 1)
    least = np.minimum(np.minimum(least[:-2], least[1:-1]), least[2:])
    result: NDArray[np.float32] = np.minimum(
        np.minimum(least[:, :-2], least[:, 1:-1]), least[:, 2:]
    )
    return result


def _leave_out(points: FramePoints, boxes: Boxes, step: int) -> None:
    """Mark the points in boxes as unknown."""
    first = step // 2
    for x1, y1, x2, y2 in boxes.astype(np.float64):
        margin = _AROUND * max(x2 - x1, y2 - y1)
        left, top = (max(int((c - margin - first) / step), 0) for c in (x1, y1))
        right, bottom = (max(int((c + margin - first) / step) + 2, 0) for c in (x2, y2))
        points.depth[top:bottom, left:right] = np.nan
