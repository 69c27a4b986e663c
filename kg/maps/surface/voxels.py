"""Voxels: their keys, their records, and the surface that readers get as arrays.

A key is one integer: the voxel's chunk of 64 x 64 x 64 in its high bits, its place in the chunk in
its low 18 bits. Voxel (0, 0, 0) has a corner in the origin of the map frame.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

SIDE: Final = 64  # voxels along a side of a chunk
LOCAL_BITS: Final = 18  # of a key: the voxel's place in its chunk
RANGE: Final = 1 << 20  # voxels from the origin in each direction: 26 km of 2.5 cm

#: `gone`, `first`: numbers of transactions, `gone` 0 while it is there; `last` [s since 1970]
RECORD: Final = np.dtype(
    [
        ("local", "<u4"),
        ("colour", "u1", (3,)),
        ("count", "<u2"),
        ("source", "<u2"),
        ("last", "<u4"),
        ("first", "<u4"),
        ("gone", "<u4"),
    ]
)

Keys = NDArray[np.int64]
Records = NDArray[Any]


@dataclass(frozen=True, slots=True)
class FrameVoxels:
    """Voxels of one frame."""

    seen: Keys  # (n,) voxels with a surface in them, sorted
    colour: NDArray[np.uint8]  # (n, 3) their mean colour in the frame
    passed: Keys  # (m,) voxels of the map that the frame looked through, sorted
    stamp: float  # [s since 1970]


@dataclass(frozen=True, slots=True)
class MarkedFrame:
    """Voxels of a frame that is in the map."""

    voxels: FrameVoxels
    mark: int  # number of its transaction
    source: int  # number of its recording


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Surface of a map: one row for each voxel in which a surface was seen.

    Arrays are parallel and of length n.
    """

    size: float  # [m] side of a voxel; 0 where the map has no surface
    points: NDArray[np.float32]  # (n, 3) [m] centres of the voxels, map frame
    colours: NDArray[np.uint8]  # (n, 3) red, green, blue: the mean of about the last 16 frames
    count: NDArray[np.uint16]  # (n,) frames that showed it; halved where one looked through it
    last_seen: NDArray[np.float64]  # (n,) [s since 1970], to the second

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls) -> Surface:
        """The surface of a map that has none."""
        return surface_of(0.0, np.empty(0, np.int64), np.empty(0, RECORD))


def keys_of(cells: NDArray[np.int64]) -> Keys:
    """Keys (n,) of voxels (3, n), counted from the origin along x, y and z."""
    x, y, z = cells + RANGE
    low = (x & 63) << 12 | (y & 63) << 6 | (z & 63)
    keys: Keys = (x >> 6) << 48 | (y >> 6) << 33 | (z >> 6) << LOCAL_BITS | low
    return keys


def cells_of(keys: Keys) -> NDArray[np.int64]:
    """Voxels (3, n) of keys (n,): the inverse of `keys_of`."""
    chunk = np.stack([keys >> 48, keys >> 33 & 0x7FFF, keys >> LOCAL_BITS & 0x7FFF])
    low = np.stack([keys >> 12 & 63, keys >> 6 & 63, keys & 63])
    return (chunk << 6 | low) - RANGE


def surface_of(size: float, keys: Keys, records: Records) -> Surface:
    """Surface of voxels with side `size` [m]."""
    return Surface(
        size=size,
        points=((cells_of(keys).T + 0.5) * size).astype(np.float32),
        colours=np.ascontiguousarray(records["colour"]),
        count=records["count"].copy(),
        last_seen=records["last"].astype(np.float64),
    )


def coarser(surface: Surface, max_voxels: int) -> Surface:
    """Surface of at most `max_voxels`: voxels are joined in twos along each axis until they fit."""
    while len(surface) > max_voxels:
        size = 2 * surface.size
        cells = np.floor(surface.points.T.astype(np.float64) / size).astype(np.int64)
        keys, first, inverse = np.unique(keys_of(cells), return_index=True, return_inverse=True)
        members = np.bincount(inverse)
        colours = [np.bincount(inverse, surface.colours[:, n]) / members for n in range(3)]
        last = np.zeros(len(keys))
        np.maximum.at(last, inverse, surface.last_seen)
        surface = Surface(
            size=size,
            points=((cells_of(keys).T + 0.5) * size).astype(np.float32),
            colours=np.stack(colours, 1).round().astype(np.uint8),
            count=surface.count[first],
            last_seen=last,
        )
    return surface


MEDIA_TYPE: Final = "application/vnd.hereabouts.surface"
MAX_VOXELS: Final = 300_000  # of one answer; larger surfaces are joined into larger voxels
_REACH: Final = 32_000  # voxels from the origin
_COLUMNS: Final = (("<u4", 1), ("<i2", 3), ("<u2", 1), ("u1", 3))


def encoded(surface: Surface, max_voxels: int = MAX_VOXELS) -> bytes:
    """Bytes of a surface, with larger voxels where it has more than `max_voxels`."""
    surface = coarser(surface, max_voxels)
    while len(surface) and np.ptp(surface.points, axis=0).max() > 2 * _REACH * surface.size:
        surface = coarser(surface, len(surface) - 1)
    n = len(surface)
    low, high = (surface.points.min(0), surface.points.max(0)) if n else (np.zeros(3), np.zeros(3))
    origin = low + np.floor((high - low) / 2 / (surface.size or 1)) * surface.size
    cells = np.rint((surface.points - origin) / (surface.size or 1)).astype("<i2")
    values = {"size": surface.size, "origin": origin.astype(float).tolist(), "voxels": n}
    header = json.dumps(values).encode()
    header += b" " * (-len(header) % 4)
    columns = (
        surface.last_seen.astype("<u4"),
        cells.T,
        surface.count.astype("<u2"),
        surface.colours.T,
    )
    parts = [column.tobytes() for column in columns]
    return b"".join([len(header).to_bytes(4, "little"), header, *parts])


def decoded(data: bytes) -> Surface:
    """Surface of `encoded` bytes; raises ValueError for others."""
    start = 4 + int.from_bytes(data[:4], "little")
    header = json.loads(data[4:start])
    n, columns = int(header["voxels"]), []
    for kind, width in _COLUMNS:
        columns.append(np.frombuffer(data, kind, n * width, start).reshape(width, n))
        start += n * width * np.dtype(kind).itemsize
    last, cells, count, colours = columns
    points = cells.T * float(header["size"]) + np.array(header["origin"], np.float64)
    return Surface(
        size=float(header["size"]),
        points=points.astype(np.float32),
        colours=np.ascontiguousarray(colours.T),
        count=count[0],
        last_seen=last[0].astype(np.float64),
    )
