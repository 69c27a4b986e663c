"""The history of a map as a file that workers can read."""

from __future__ import annotations

import threading
import uuid
from contextlib import closing
from pathlib import Path

from kg.history.storage.log import HistoryLog
from kg.model.sqlite_files import connect


class HistoryFile:
    """The history file of a map, or a copy in `home` of a history in memory.

    Safe from any thread.
    """

    def __init__(self, log: HistoryLog, base: str, home: Path | None) -> None:
        self._log, self._base, self._home = log, base, home
        self._guard = threading.Lock()
        self._copy: Path | None = None
        self._copied = -1  # the last transaction in the copy

    def request(self) -> dict[str, str]:
        """Path of the history and base of the map, as a part of a request."""
        return {"log": str(self._path()), "base": self._base}

    def _path(self) -> Path:
        if self._log.file is not None:
            return self._log.file.resolve()
        with self._guard, self._log.lock:
            if self._copy is None:
                assert self._home is not None, "a map in memory has a folder for snapshots"
                self._copy = self._home / "history.sqlite"
            if self._copied != self._log.last:
                fresh = self._copy.with_name(f"{uuid.uuid4()}.sqlite")
                with closing(connect(fresh)) as copy:
                    self._log.db.backup(copy)
                fresh.replace(self._copy)  # readers of the old file keep it open
                self._copied = self._log.last
            return self._copy
