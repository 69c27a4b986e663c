"""A map's history as a file that workers may read, and past states of it as folders.

Of a map that is not large, a worker makes in its memory what a query can see of the past
(`kg.history.moment`), and needs the file alone. Of a large one that takes too long: there a past
state is a copy of the map as it is (hard links, where it lies on disk) on which a worker undoes
what changed since; the last few that were asked for are kept.
"""

from __future__ import annotations

import shutil
import sqlite3
import threading
import time
import uuid
import weakref
from collections import OrderedDict
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from kg.errors import GraphError
from kg.history.log import Log
from kg.store import MapStore
from kg.workers.snapshots import Snapshot, copy_store, make_home, remove_home

KEPT: Final = 4
#: Subjects whose past is folded for a query, which takes about a second then.
FOLDED: Final = 20_000


class Pasts:
    """The past states of one map; safe from several threads."""

    def __init__(self, store: MapStore, log: Log, base: str) -> None:
        self._store, self._log, self._base = store, log, base
        self._guard, self._making = threading.Lock(), threading.Lock()
        self._readers: dict[Snapshot, int] = {}
        self._kept: OrderedDict[int, Snapshot] = OrderedDict()  # the latest asked for last
        self._home: Path | None = None
        self._closed: weakref.finalize[..., Pasts] | None = None
        self._copied = -1  # the last transaction of a history that lies in memory, in its copy

    @property
    def small(self) -> bool:
        """Whether a query may have a state of it made for itself."""
        with self._log.lock:
            (subjects,) = self._log.db.execute("SELECT max(id) FROM node").fetchone()
        return (subjects or 0) <= FOLDED

    def lease(self, sequence: int, make: Callable[[dict[str, Any]], None]) -> Snapshot:
        """The state right after that transaction, kept until `release`.

        Where it is not there, `make` has a worker change a copy of the map (`kg.workers.past`).
        """
        with self._making:  # who waits finds it made
            found = self._leased(sequence)
            if found is not None:
                return found
            folder = self._copy_of_map()
            try:
                make({"folder": str(folder), "sequence": sequence, **self.history()})
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            return self._keep(folder, sequence)

    def release(self, snapshot: Snapshot) -> None:
        """Let go of a leased state; others than ours are none of our business."""
        with self._guard:
            if snapshot in self._readers:
                self._readers[snapshot] -= 1
                self._remove_unread()

    def history(self) -> dict[str, str]:
        """Where workers find the history, and whose it is."""
        return {"log": str(self._file()), "base": self._base}

    def close(self) -> None:
        """Remove all of them."""
        with self._guard:
            if self._closed is not None:
                self._closed()
            self._readers.clear()
            self._kept.clear()

    def _leased(self, sequence: int) -> Snapshot | None:
        with self._guard:
            found = self._kept.get(sequence)
            if found is not None:
                self._kept.move_to_end(sequence)
                self._readers[found] = self._readers.get(found, 0) + 1
            return found

    def _copy_of_map(self) -> Path:
        with self._guard:
            folder = self._folder() / str(uuid.uuid4())
        try:
            copy_store(self._store, folder)
        except OSError as error:
            raise GraphError(f"cannot copy the map to {folder}: {error}") from error
        return folder

    def _keep(self, folder: Path, sequence: int) -> Snapshot:
        with self._guard:
            made = Snapshot(folder, sequence, time.monotonic(), True)
            self._kept[sequence], self._readers[made] = made, 1
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            self._remove_unread()
            return made

    def _file(self) -> Path:
        """The history's own file; of one in memory a copy that is up to date."""
        if self._log.file is not None:
            return self._log.file.resolve()
        with self._guard, self._log.lock:
            file = self._folder() / "history.sqlite"
            if self._copied != self._log.last:
                fresh = file.with_name(f"{uuid.uuid4()}.sqlite")
                with closing(sqlite3.connect(fresh)) as copy:
                    self._log.db.backup(copy)
                fresh.replace(file)  # who reads the one before goes on with it
                self._copied = self._log.last
            return file

    def _folder(self) -> Path:
        """Where they lie; made when the past is first asked for."""
        if self._home is None:
            try:
                self._home, lock = make_home(self._store.path)
            except GraphError:  # a map that is only read may lie where nobody can write
                self._home, lock = make_home(None)
            self._closed = weakref.finalize(self, remove_home, self._home, lock)
        return self._home

    def _remove_unread(self) -> None:
        for snapshot in [s for s, readers in self._readers.items() if readers <= 0]:
            if snapshot not in self._kept.values():
                del self._readers[snapshot]
                shutil.rmtree(snapshot.folder, ignore_errors=True)
