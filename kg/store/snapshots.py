"""Snapshots of a live map for other processes: hard links beside it, or a small copy.

A folder of Oxigraph must not be read while another process writes it. A backup is a separate folder
without a writer. It shares its files with the map by hard links, so it needs no space until the map
replaces the files.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
import uuid
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pyoxigraph import Store

from kg.model.errors import DiskFullError, GraphError, WorkerDiedError
from kg.model.platforms import lock
from kg.store.folder import disk_full, free_space, is_disk_full, remove_abandoned, write_error
from kg.store.transactional import TransactionalStore

SCRATCH: Final = "scratch"  # folder beside the snapshots
_WORKERS_NEED = 1 << 20  # [bytes] of free space


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A frozen state of the map."""

    folder: Path  # an Oxigraph store, opened read-only by its readers
    sequence: int  # of the map at its beginning; it may hold later transactions
    made: float  # [s] on the monotonic clock
    owned: bool  # whether the folder is to be removed


class Snapshots:
    """The snapshots of one map: the newest, and those with readers.

    Raises GraphError if no folder can be made beside the map.
    """

    def __init__(self, store: TransactionalStore, *, refresh: float) -> None:
        self._store = store
        self._refresh = refresh
        self._guard = threading.Lock()
        self._making = threading.Lock()  # held by the thread that makes a snapshot
        self._readers: dict[Snapshot, int] = {}
        self._current: Snapshot | None = None
        self.home: Path | None = None  # folder of the snapshots
        self._next_attempt = 0.0  # [s] on the monotonic clock, after the disk was full
        self._closed: weakref.finalize[..., Snapshots] | None = None
        if not (store.read_only and store.on_disk):
            self.home, lock = make_home(store.path if store.on_disk else None)
            self._closed = weakref.finalize(self, remove_home, self.home, lock)
            (self.home / SCRATCH).mkdir()

    @property
    def readable(self) -> list[Path]:
        """Folders that the readers of snapshots and of the history open."""
        folders = dict.fromkeys((self._store.path, self._store.files, self.home))
        return [folder.resolve() for folder in folders if folder is not None]

    @property
    def writable(self) -> list[Path]:
        """Folder of the copies that updates write."""
        return [] if self.home is None else [self.home / SCRATCH]

    @contextmanager
    def leased(self, at_least: int = 0) -> Iterator[Snapshot]:
        """The snapshot of `lease` for a block."""
        snapshot = self.lease(at_least)
        try:
            yield snapshot
        finally:
            self.release(snapshot)

    def lease(self, at_least: int = 0) -> Snapshot:
        """The newest snapshot, kept until `release`.

        A new snapshot is made first if the newest lacks transaction `at_least`, or if the map has
        changed and the newest is older than `refresh` seconds. Where none can be made, as on a full
        disk, the newest with transaction `at_least` is used. Raises GraphError if there is none.
        """
        refreshed = False
        while True:
            with self._guard:
                current = self._current
                if current is not None and self._is_enough(current, at_least, refreshed):
                    self._readers[current] = self._readers.get(current, 0) + 1
                    return current
            try:
                self.refresh(at_least)
            except GraphError:
                current = self._current
                if current is None or current.sequence < at_least:
                    raise
            refreshed = True

    def refresh(self, at_least: int | None = None) -> None:
        """Make a new snapshot if the map has changed; readers use the old one meanwhile.

        With `at_least`: only if the newest lacks that transaction or is too old.
        """
        with self._making:
            current = self._current
            if current is not None and not self._is_due(current, at_least):
                return
            if time.monotonic() < self._next_attempt:
                raise disk_full(self._store.where)
            try:
                made = self._make()
            except DiskFullError:
                self._next_attempt = time.monotonic() + self._refresh
                raise
            with self._guard:
                self._current = made
                self._remove_unread()

    def release(self, snapshot: Snapshot) -> None:
        """Release a leased snapshot; removed once it has no reader and a newer one exists."""
        with self._guard:
            if snapshot in self._readers:  # else all were removed by `close`
                self._readers[snapshot] -= 1
            self._remove_unread()

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """A path beside the snapshots where a folder may be made; removed after the block."""
        if self.home is None:
            raise GraphError("the map is open for reading only; open it to write")
        folder = self.home / SCRATCH / str(uuid.uuid4())
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def close(self) -> None:
        """Remove all snapshots."""
        with self._guard:
            if self._closed is not None:
                self._closed()
            self._readers.clear()
            self._current = None

    def _is_due(self, current: Snapshot, at_least: int | None) -> bool:
        moved = current.sequence < self._store.sequence
        if at_least is None:
            return moved
        return moved and (current.sequence < at_least or self._is_old(current))

    def _is_enough(self, current: Snapshot, at_least: int, refreshed: bool) -> bool:
        if current.sequence >= self._store.sequence:
            return True
        if current.sequence < at_least:
            return False
        return refreshed or not self._is_old(current)

    def _is_old(self, current: Snapshot) -> bool:
        return time.monotonic() - current.made >= self._refresh

    def _make(self) -> Snapshot:
        # read before the backup, so that the snapshot holds at least this transaction
        sequence, made = self._store.sequence, time.monotonic()
        if self.home is None and self._store.files is not None:
            # readers have another working directory
            return Snapshot(self._store.files.resolve() / "store", sequence, made, False)
        assert self.home is not None
        folder = self.home / str(uuid.uuid4())
        try:
            copy_store(self._store, folder)
        except OSError as error:
            where, action = self._store.where, f"cannot make a snapshot at {folder}"
            raise write_error(error, where, action) from error
        return Snapshot(folder, sequence, made, True)

    @contextmanager
    def naming_full_disk(self) -> Iterator[None]:
        """Raise DiskFullError with the map's name where a worker fails since its disk is full."""
        try:
            yield
        except (DiskFullError, WorkerDiedError) as error:
            beside = self.home.parent if self.home else Path(tempfile.gettempdir())
            if isinstance(error, DiskFullError) or free_space(beside) < _WORKERS_NEED:
                raise disk_full(self._store.where) from error
            raise

    def _remove_unread(self) -> None:
        for snapshot in [s for s, readers in self._readers.items() if readers <= 0]:
            if snapshot is not self._current:
                del self._readers[snapshot]
                if snapshot.owned:
                    shutil.rmtree(snapshot.folder, ignore_errors=True)


def copy_store(store: TransactionalStore, folder: Path) -> None:
    """Copy the map to a folder, by hard links if it is on disk."""
    if store.on_disk:
        store.recover()
        store.backup(folder)
        return
    copy = Store(str(folder))
    copy.bulk_extend(store.native)
    copy.flush()


def make_home(path: Path | None) -> tuple[Path, int]:
    """A locked folder for snapshots, beside the map since hard links cross no file system."""
    beside = path.resolve() if path else Path(tempfile.gettempdir()) / "hereabouts"
    remove_abandoned(beside, "snapshots")
    name = uuid.uuid4().hex
    home, making = (beside.parent / f".{beside.name}.{k}-{name}" for k in ("snapshots", "making"))
    try:
        making.mkdir(mode=0o700)
        descriptor = os.open(making / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        lock(descriptor)
        making.rename(home)  # once it is locked, so that no process removes it as abandoned
    except OSError as error:
        if is_disk_full(error):
            raise disk_full(beside) from error
        raise GraphError(
            f"cannot make {home} for snapshots: {error.strerror}; queries of clients need "
            "snapshots beside the map, so its parent folder must be writable"
        ) from error
    return home, descriptor


def remove_home(home: Path, lock: int) -> None:
    """Remove a folder that `make_home` made."""
    shutil.rmtree(home, ignore_errors=True)
    os.close(lock)
