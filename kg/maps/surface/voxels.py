"""Voxels: keys, records, the sparse grid in memory, and the surface that readers get as arrays.

A key is one integer: the voxel's chunk of 64 x 64 x 64 in its high bits, its place in the chunk in
its low 18 bits. Voxel (0, 0, 0) has a corner in the origin of the map frame.

The grid has sparse chunks of records and is changed by a few frames at a time. Each change
depends on the grid and the frames alone, so that the same frames applied again after a restart make
the same grid.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
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
    cells: NDArray[np.int64] = np.empty((3, len(keys)), np.int64)
    for cell, chunk, low in zip(cells, (48, 33, LOCAL_BITS), (12, 6, 0), strict=True):
        np.add((keys >> chunk & 0x7FFF) << 6, (keys >> low & 63) - RANGE, out=cell)
    return cells


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


MAX_VOXELS_OF_A_MAP: Final = 1_500_000  # of one map: about 150 m2 of flat at 2.5 cm
_MEMORY: Final = 16  # frames that the mean colour remembers
_MAX_COUNT: Final = 65535  # that a count holds
_LOCAL: Final = (1 << LOCAL_BITS) - 1


class VoxelGrid:
    """Voxel records by chunk, sorted by their place in it."""

    def __init__(self, size: float) -> None:
        self.size = size  # [m] side of a voxel
        self.chunks: dict[int, Records] = {}
        self.changed: set[int] = set()  # chunks, since they were last written
        self.voxels = 0  # records, with those of voxels that are gone
        self.full = False  # whether a voxel was left out since there were too many

    def apply(self, frames: Sequence[MarkedFrame]) -> None:
        """Count frames, in their order: first all that they look through, then all they see."""
        passed, times = np.unique(
            np.concatenate([one.voxels.passed for one in frames]), return_counts=True
        )
        for chunk, part in by_chunk(passed):
            self._look_through(chunk, passed[part] & _LOCAL, times[part], frames[-1].mark)
        keys, new = _together(frames)
        for chunk, part in by_chunk(keys):
            self._see(chunk, new[part])

    def with_frames(self, frames: Sequence[MarkedFrame]) -> VoxelGrid:
        """A grid with frames counted too; this one stays as it is."""
        keys = [k for one in frames for k in (one.voxels.seen, one.voxels.passed)]
        touched = {chunk for some in keys for chunk, _ in by_chunk(some)}
        other = VoxelGrid(self.size)
        other.chunks = {k: c.copy() if k in touched else c for k, c in self.chunks.items()}
        other.voxels = self.voxels
        if frames:
            other.apply(frames)
        return other

    def put(self, chunk: int, records: Records) -> None:
        """Set the records of one chunk."""
        self.voxels += len(records) - len(self.chunks.get(chunk, ()))
        self.chunks[chunk] = records

    def remove_source(self, source: int, mark: int) -> None:
        """Voxels that a recording saw last are gone with transaction `mark`."""
        for chunk, records in self.chunks.items():
            theirs = (records["source"] == source) & (records["gone"] == 0)
            if theirs.any():
                records["gone"][theirs] = mark
                self.changed.add(chunk)

    def add_grid(self, other: VoxelGrid, mark: int, source: int) -> None:
        """Add the voxels that are there in `other`, as seen in transaction `mark`."""
        for chunk, records in other.chunks.items():
            there = records[records["gone"] == 0]
            there["first"], there["source"] = mark, source
            self._see(chunk, there)

    def present(self, sequence: int | None = None, min_count: int = 1) -> tuple[Keys, Records]:
        """Voxels that are there: now, or those seen by transaction `sequence` and not gone yet.

        A past voxel has the present colour, and is there whatever its present count.
        """
        keys, records = [np.empty(0, np.int64)], [np.empty(0, RECORD)]
        for chunk in sorted(self.chunks):
            held = self.chunks[chunk]
            records.append(held[_there(held, sequence, min_count)])
            keys.append(chunk << LOCAL_BITS | records[-1]["local"].astype(np.int64))
        return np.concatenate(keys), np.concatenate(records)

    def area(self, sequence: int | None = None, min_count: int = 1) -> float:
        """[m^2] of the surface that is there: a side of each voxel of `present`."""
        there = (_there(held, sequence, min_count).sum() for held in self.chunks.values())
        return float(sum(there)) * self.size**2

    def within(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centres (n, 3) [m] of voxels that are there, between two corners (3,) [m]."""
        first, last = (np.floor(corner / self.size).astype(np.int64) for corner in (low, high))
        chunks = self._chunks_between(first, last)
        held = (self.chunks[chunk] for chunk in chunks)
        found = [records["local"][records["gone"] == 0] for records in held]
        start = np.repeat(np.array(chunks, np.int64), [*map(len, found)])
        local: Keys = np.concatenate([*found, np.empty(0, np.uint32)]).astype(np.int64)
        cells = cells_of(start << LOCAL_BITS | local)
        inside = ((cells >= first[:, None]) & (cells <= last[:, None])).all(0)
        return np.asarray((cells[:, inside].T + 0.5) * self.size, np.float64)

    def _chunks_between(self, first: Keys, last: Keys) -> list[int]:
        """Chunks with voxels between two cells (3,)."""
        corners = [
            np.arange(a // SIDE, b // SIDE + 1) * SIDE for a, b in zip(first, last, strict=True)
        ]
        cells = np.stack(np.meshgrid(*corners, indexing="ij")).reshape(3, -1)
        return [key for key in (keys_of(cells) >> LOCAL_BITS).tolist() if key in self.chunks]

    def _look_through(self, chunk: int, local: Keys, times: Keys, mark: int) -> None:
        records = self.chunks.get(chunk)
        if records is None:
            return
        rows, found = _rows(records, local)
        rows, times = rows[found], times[found]
        left = records["count"][rows] >> np.minimum(times, 15).astype(np.uint16)
        gone = (left == 0) & (records["gone"][rows] == 0)
        records["count"][rows] = left
        records["gone"][rows[gone]] = mark
        self.changed.add(chunk)

    def _see(self, chunk: int, new: Records) -> None:
        held = self.chunks.get(chunk)
        if held is None:
            held = np.empty(0, RECORD)
        rows, found = _rows(held, new["local"])
        self._see_again(held, rows[found], new[found])
        rows, new = rows[~found], new[~found]
        if self.voxels + len(new) > MAX_VOXELS_OF_A_MAP:
            self.full = True
        elif len(new):
            self.put(chunk, np.insert(held, rows, new))
        if chunk in self.chunks:
            self.changed.add(chunk)

    @staticmethod
    def _see_again(held: Records, rows: Keys, new: Records) -> None:
        known = held[rows]
        back = known["gone"] > 0
        before = np.where(back, 0, known["count"]).astype(np.int64)
        total = np.minimum(before + new["count"], _MAX_COUNT)
        weight = np.maximum(np.minimum(total, _MEMORY) // new["count"], 1)[:, None]
        colour = known["colour"].astype(np.int64)
        change = new["colour"] - colour
        # rounded away from zero, so that a small change is not lost for ever
        step = np.sign(change) * -(-np.abs(change) // weight)
        known["colour"] = colour + step
        known["count"] = total
        known["last"], known["source"] = np.maximum(known["last"], new["last"]), new["source"]
        known["gone"] = 0
        held[rows] = known


def _there(held: Records, sequence: int | None, min_count: int) -> NDArray[np.bool_]:
    there: NDArray[np.bool_] = (held["gone"] == 0) & (held["count"] >= min_count)
    if sequence is not None:
        there |= held["gone"] > sequence
        there &= held["first"] <= sequence
    return there


def by_chunk(keys: Keys) -> Iterator[tuple[int, slice]]:
    """The chunk of sorted keys, and the slice of those in it."""
    if not len(keys):
        return
    chunks = keys >> LOCAL_BITS
    starts = np.flatnonzero(np.diff(chunks, prepend=-1))
    for start, end in zip(starts, [*starts[1:], len(keys)], strict=True):
        yield int(chunks[start]), slice(start, end)


def _together(frames: Sequence[MarkedFrame]) -> tuple[Keys, Records]:
    """Voxels that the frames see, sorted, each once."""
    keys = np.concatenate([one.voxels.seen for one in frames])
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    if not len(starts):
        return keys, np.empty(0, RECORD)
    number = np.repeat(np.arange(len(frames)), [len(one.voxels.seen) for one in frames])[order]
    earliest, latest = number[starts], number[np.append(starts[1:], len(keys)) - 1]
    count = np.diff(starts, append=len(keys))
    colour = np.concatenate([one.voxels.colour for one in frames]).take(order, axis=0)
    new = np.zeros(len(starts), RECORD)
    new["local"], new["count"] = keys[starts] & _LOCAL, count
    new["colour"] = np.add.reduceat(colour, starts, dtype=np.int64) // count[:, None]
    new["first"] = np.array([one.mark for one in frames])[earliest]
    new["last"] = np.array([int(one.voxels.stamp) for one in frames])[latest]
    new["source"] = np.array([one.source for one in frames])[latest]
    return keys[starts], new


def _rows(records: Records, local: Records) -> tuple[Keys, Records]:
    """Row of each voxel, or the row before which it belongs, and whether it is there."""
    held = records["local"]
    rows = np.searchsorted(np.ascontiguousarray(held), local)
    if not len(held):
        return rows, np.zeros(len(local), np.bool_)
    return rows, held[np.minimum(rows, len(held) - 1)] == local
