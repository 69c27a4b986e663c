"""Snapshots of a live map that other processes may read: hard links beside it, or a small copy.

Reading Oxigraph's folder while another process writes it is undefined; a backup of it is a folder
of its own that nobody writes. Backups share their files with the map, so they cost links, not
bytes, until the map compacts the files away.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import threading
import time
import uuid
import weakref
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Store

from kg.errors import GraphError
from kg.map_folder import remove_abandoned
from kg.store import MapStore


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One frozen state of the map."""

    folder: Path  # an Oxigraph store, opened read-only by its readers
    sequence: int  # of the map when it was begun; it may already hold a later transaction
    made: float  # [s] on the monotonic clock
    owned: bool  # whether the folder is ours to remove


class Snapshots:
    """The snapshots of one map; the newest, and those that somebody still reads.

    Raises GraphError where no folder can be made beside the map.
    """

    def __init__(self, store: MapStore, *, refresh: float) -> None:
        self._store = store
        self._refresh = refresh
        self._guard = threading.Lock()
        self._readers: dict[Snapshot, int] = {}
        self._current: Snapshot | None = None
        self._home: Path | None = None
        self._closed: weakref.finalize[..., Snapshots] | None = None
        if not (store.read_only and store.path):
            self._home, lock = make_home(store.path)
            self._closed = weakref.finalize(self, remove_home, self._home, lock)

    def lease(self, at_least: int = 0) -> Snapshot:
        """The newest snapshot, kept until `release`.

        A new one is made when the map has moved and the last is older than `refresh`, or holds
        less than transaction `at_least`.
        """
        with self._guard:
            current = self._current
            if current is None or self._outdated(current, at_least):
                self._current = self._make()
                self._remove_unread()
                current = self._current
            self._readers[current] = self._readers.get(current, 0) + 1
            return current

    def release(self, snapshot: Snapshot) -> None:
        """Let go of a leased snapshot; removed once nobody reads it and a newer one is there."""
        with self._guard:
            if snapshot in self._readers:  # else all were removed by `close`
                self._readers[snapshot] -= 1
            self._remove_unread()

    def close(self) -> None:
        """Remove all of them."""
        with self._guard:
            if self._closed is not None:
                self._closed()
            self._readers.clear()
            self._current = None

    def _outdated(self, current: Snapshot, at_least: int) -> bool:
        now = self._store.sequence
        if current.sequence >= now:
            return False
        return current.sequence < at_least or time.monotonic() - current.made >= self._refresh

    def _make(self) -> Snapshot:
        # read before the backup: a transaction in between is in the snapshot, never missing from it
        sequence, made = self._store.sequence, time.monotonic()
        if self._home is None:
            # workers have another working directory
            folder = Path(self._store.where).resolve() / "store"
            return Snapshot(folder, sequence, made, False)
        folder = self._home / str(uuid.uuid4())
        try:
            copy_store(self._store, folder)
        except OSError as error:
            raise GraphError(f"cannot make a snapshot at {folder}: {error}") from error
        return Snapshot(folder, sequence, made, True)

    def _remove_unread(self) -> None:
        for snapshot in [s for s, readers in self._readers.items() if readers <= 0]:
            if snapshot is not self._current:
                del self._readers[snapshot]
                if snapshot.owned:
                    shutil.rmtree(snapshot.folder, ignore_errors=True)


def copy_store(store: MapStore, folder: Path) -> None:
    """The map as it is now, in a folder of its own: by hard links where it lies on disk."""
    if store.path is not None:
        store.native.backup(str(folder))
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
        lock = os.open(making / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        making.rename(home)  # nobody meets it unlocked, and takes it for abandoned
    except OSError as error:
        raise GraphError(
            f"cannot make {home} for snapshots: {error.strerror}; queries of others are answered "
            "from snapshots beside the map, so its parent folder must be writable"
        ) from error
    return home, lock


def remove_home(home: Path, lock: int) -> None:
    """Remove a folder that `make_home` made."""
    shutil.rmtree(home, ignore_errors=True)
    os.close(lock)
