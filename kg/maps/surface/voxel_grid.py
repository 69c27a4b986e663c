"""Voxel grid: sparse chunks of voxel records in memory, changed by a few frames at a time.

Each change depends on the grid and the frames alone, so that the same frames applied again after a
restart make the same grid.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.surface.voxels import (
    LOCAL_BITS,
    RECORD,
    SIDE,
    Keys,
    MarkedFrame,
    Records,
    cells_of,
    keys_of,
)

MAX_VOXELS: Final = 1_500_000  # of one map: about 150 m2 of flat at 2.5 cm
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
        found = [np.empty((3, 0), np.int64)]
        for chunk in self._chunks_between(first, last):
            held = self.chunks[chunk]
            keys = chunk << LOCAL_BITS | held["local"][held["gone"] == 0].astype(np.int64)
            cells = cells_of(keys)
            found.append(cells[:, ((cells >= first[:, None]) & (cells <= last[:, None])).all(0)])
        return np.asarray((np.concatenate(found, 1).T + 0.5) * self.size, np.float64)

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
        if self.voxels + len(new) > MAX_VOXELS:
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
    colour = np.concatenate([one.voxels.colour for one in frames])[order]
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
