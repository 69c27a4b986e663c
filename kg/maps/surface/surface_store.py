"""Surface store: the voxels of a map in `surface.sqlite` beside the history, in step with it.

Chunks of 64 x 64 x 64 voxels are compressed rows. The voxels of a frame are a row of their own,
written before the frame's transaction and marked with its number. Eight frames at a time go into
the grid, and every 64 frames the changed chunks are written and their rows dropped. After a kill
the chunks and the rows up to the map's last transaction make the same grid. A voxel remembers the
transactions that it came and went with, so a past state needs no second copy.
"""

from __future__ import annotations

import sqlite3
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from kg.maps.surface.voxels import (
    LOCAL_BITS,
    RECORD,
    FrameVoxels,
    MarkedFrame,
    Records,
    Surface,
    VoxelGrid,
    surface_of,
)
from kg.model.errors import GraphError
from kg.model.sqlite_files import open_sqlite
from kg.store.folder import disk_full, free_space, is_disk_full

FILE: Final = "surface.sqlite"
MAX_BYTES: Final = 1 << 27  # of a file that is read
_VERSION: Final = 1
_SCHEMA: Final = (
    "CREATE TABLE meta (name TEXT PRIMARY KEY, value)",
    "CREATE TABLE sources (number INTEGER PRIMARY KEY, name TEXT UNIQUE)",
    "CREATE TABLE chunks (key INTEGER PRIMARY KEY, voxels INTEGER, data BLOB)",
    "CREATE TABLE frames (number INTEGER PRIMARY KEY, mark INTEGER, source INTEGER, stamp REAL,"
    " seen BLOB, colour BLOB, passed BLOB)",
)
_BATCH: Final = 8  # frames that go into the grid together, by their number
_DUE: Final = 64  # frames after which chunks are written
_MIN_SPACE: Final = 1 << 16  # [bytes] of the disk, for the files that SQLite makes while reading
_MAX_CHUNK: Final = 1 << LOCAL_BITS


class SurfaceStore:
    """The surface of one map: in the folder of a map, or in memory alone.

    Safe to use from several threads. `sequence` is the map's last transaction when it was opened.
    Its methods raise GraphError for a file that is damaged or cannot be written.
    """

    def __init__(
        self,
        folder: Path | None,
        sequence: int,
        *,
        read_only: bool = False,
        live: bool = False,
    ) -> None:
        self._path = None if folder is None else folder / FILE
        self._sequence, self._read_only, self._live = sequence, read_only, live
        self._lock = threading.RLock()
        self._file: sqlite3.Connection | None = None
        self._grid: VoxelGrid | None = None
        self._sources: dict[str, int] = {}
        self._loaded = False
        self._waiting = list[MarkedFrame]()  # accepted, not in the grid yet
        self.frames = 0  # counted so far

    def begin(self, size: float) -> VoxelGrid:
        """The grid for writing; a new one has voxels of side `size` [m]."""
        with self._lock, self._guarded():
            self._load()
            if self._file is None and self._path is not None:
                self._file = self._opened(self._path)
            if self._grid is None:
                self._grid = VoxelGrid(size)
                if self._file is not None:
                    with self._file as file:
                        file.execute("INSERT OR REPLACE INTO meta VALUES ('size', ?)", (size,))
            return self._grid

    def write(self, frame: FrameVoxels, recording: str, mark: int) -> None:
        """Write the voxels of a frame, to hold from transaction `mark` on."""
        with self._lock, self._guarded():
            source = self._source(recording)
            if self._file is not None:
                seen, colour, passed = (
                    array.tobytes() for array in (frame.seen, frame.colour, frame.passed)
                )
                row = (self.frames + 1, mark, source, frame.stamp, seen, colour, passed)
                with self._file as file:
                    file.execute("INSERT OR REPLACE INTO frames VALUES (?, ?, ?, ?, ?, ?, ?)", row)

    def accept(self, frame: FrameVoxels, recording: str, mark: int) -> None:
        """Count a frame that was written, once its transaction is in the map."""
        with self._lock:
            self._accept(MarkedFrame(frame, mark, self._source(recording)))
            if not self.frames % _DUE:
                self.flush()

    def replace(self, recording: str, other: SurfaceStore, mark: int) -> None:
        """Replace the voxels that a recording saw last by those of `other`, its new mapping."""
        with other._lock:
            if other._grid is None:
                return
            new = other._grid.with_frames(other._waiting)
            with self._lock:
                grid = self.begin(new.size)
                self._merge()
                source = self._source(recording)
                grid.remove_source(source, mark)
                if grid.size == new.size:
                    grid.add_grid(new, mark, source)
                self.flush()

    def flush(self, level: int = 1) -> None:
        """Write the changed chunks, and drop the rows of their frames; `level` of compression."""
        with self._lock, self._guarded():
            if self._grid is None:
                return
            changed, self._grid.changed = self._grid.changed, set()
            if self._file is None or not changed:
                return
            rows = [
                (key, len(self._grid.chunks[key]), _encoded(self._grid.chunks[key], level))
                for key in sorted(changed)
            ]
            with self._file as file:
                file.executemany("INSERT OR REPLACE INTO chunks VALUES (?, ?, ?)", rows)
                done = self.frames - len(self._waiting)
                file.execute("DELETE FROM frames WHERE number <= ?", (done,))
                file.execute("INSERT OR REPLACE INTO meta VALUES ('frames', ?)", (done,))

    def surface(self, sequence: int | None = None, min_count: int = 1) -> Surface:
        """The surface now or at a transaction, of voxels counted `min_count` times; or an empty."""
        with self._lock, self._guarded():
            grid = self._with_waiting()
            if grid is None:
                return Surface.empty()
            return surface_of(grid.size, *grid.present(sequence, min_count))

    def area(self, sequence: int | None = None, min_count: int = 2) -> float:
        """[m^2] of the surface now or at a transaction; 0 without one."""
        with self._lock, self._guarded():
            grid = self._with_waiting()
            return 0.0 if grid is None else round(grid.area(sequence, min_count), 1)

    def _with_waiting(self) -> VoxelGrid | None:
        """The grid with the frames that are not in it yet."""
        self._load()
        return None if self._grid is None else self._grid.with_frames(self._waiting)

    @property
    def grid(self) -> VoxelGrid | None:
        """The grid; None before anything was written."""
        with self._lock, self._guarded():
            self._load()
            return self._grid

    def close(self) -> None:
        """Write what is left and close the file; a second call does nothing."""
        with self._lock:
            if self._file is not None:
                if not self._read_only:
                    self.flush()
                self._file.close()
                self._file = None

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError, ValueError, zlib.error) as error:
            if self._path is not None and _lacks_space(self._path, error):
                raise disk_full(self._path.parent) from error
            raise GraphError(
                f"cannot use the surface at {self._path}: {error}; move the file away to begin a "
                "new one: the map itself stays"
            ) from error

    def _load(self) -> None:
        if self._loaded:
            return
        if self._path is not None and (self._path.exists() or self._path.is_symlink()):
            self._file = self._opened(self._path)
            self._read()
            self._file.set_progress_handler(None, 0)
        self._loaded = True

    def _opened(self, path: Path) -> sqlite3.Connection:
        return open_sqlite(
            *(path, _SCHEMA, _VERSION, MAX_BYTES),
            read_only=self._read_only,
            live=self._live,
            auto_vacuum=True,
        )

    def _read(self) -> None:
        file = self._file
        assert file is not None
        meta = dict(file.execute("SELECT name, value FROM meta"))
        if not (isinstance(size := meta.get("size"), float) and size > 0):
            return
        grid = self._grid = VoxelGrid(size)
        self._waiting.clear()
        self._sources = {name: n for n, name in file.execute("SELECT number, name FROM sources")}
        for key, voxels, data in file.execute("SELECT key, voxels, data FROM chunks"):
            grid.put(key, _up_to(_decoded(data, voxels), self._sequence))
        self.frames = int(meta.get("frames", 0))
        rows = "SELECT mark, source, stamp, seen, colour, passed FROM frames"
        for mark, source, stamp, seen, colour, passed in file.execute(
            f"{rows} WHERE mark <= ? ORDER BY number", (self._sequence,)
        ):
            self._accept(MarkedFrame(_frame(stamp, seen, colour, passed), mark, source))
        if not self._read_only:
            with file:  # rows that the map's transactions do not reach
                file.execute("DELETE FROM frames WHERE mark > ?", (self._sequence,))

    def _accept(self, frame: MarkedFrame) -> None:
        self._waiting.append(frame)
        self.frames += 1
        if not self.frames % _BATCH:
            self._merge()

    def _merge(self) -> None:
        assert self._grid is not None
        if self._waiting:
            self._grid.apply(self._waiting)
            self._waiting.clear()

    def _source(self, recording: str) -> int:
        if recording not in self._sources:
            number = self._sources[recording] = len(self._sources) + 1
            if self._file is not None:
                with self._file as file:
                    file.execute("INSERT INTO sources VALUES (?, ?)", (number, recording))
        return self._sources[recording]


def _lacks_space(path: Path, error: Exception) -> bool:
    """Whether an error is that of a full disk, which SQLite may call an error of input."""
    unclear = isinstance(error, sqlite3.OperationalError) and "disk I/O" in str(error)
    return is_disk_full(error) or (unclear and free_space(path.parent) < _MIN_SPACE)


def _up_to(records: Records, sequence: int) -> Records:
    """Records without what later transactions brought, which power loss may have taken."""
    records = records[records["first"] <= sequence]
    records["gone"][records["gone"] > sequence] = 0
    return records


def _encoded(records: Records, level: int) -> bytes:
    """Records column by column, the bytes of equal weight together, compressed."""
    columns = []
    for name in RECORD.names or ():
        column = np.diff(records[name], prepend=np.uint32(0)) if name == "local" else records[name]
        octets = np.ascontiguousarray(column).view(np.uint8).reshape(len(records), -1)
        columns.append(octets.T.tobytes())
    return zlib.compress(b"".join(columns), level)


def _decoded(data: bytes, voxels: int) -> Records:
    if not 0 <= voxels <= _MAX_CHUNK:
        raise ValueError(f"a chunk has up to {_MAX_CHUNK} voxels, got {voxels}")
    unpacker = zlib.decompressobj()
    raw = unpacker.decompress(data, voxels * RECORD.itemsize + 1)
    if len(raw) != voxels * RECORD.itemsize:
        raise ValueError("a chunk is damaged")
    records, start = np.zeros(voxels, RECORD), 0
    for name in RECORD.names or ():
        width = RECORD[name].itemsize
        octets = np.frombuffer(raw, np.uint8, voxels * width, start).reshape(width, voxels)
        start += voxels * width
        column = np.ascontiguousarray(octets.T)
        records[name] = column if width == 3 else column.view(RECORD[name])[:, 0]
    records["local"] = np.cumsum(records["local"])
    if voxels and (records["local"][-1] >= _MAX_CHUNK or (np.diff(records["local"]) == 0).any()):
        raise ValueError("a chunk is damaged")
    return records


def _frame(stamp: float, seen: bytes, colour: bytes, passed: bytes) -> FrameVoxels:
    return FrameVoxels(
        seen=np.frombuffer(seen, np.int64),
        colour=np.frombuffer(colour, np.uint8).reshape(-1, 3),
        passed=np.frombuffer(passed, np.int64),
        stamp=stamp,
    )
