"""Free space of a map's disk, and the error of a disk without space."""

from __future__ import annotations

import errno
import gc
import shutil
import sqlite3
import time
from pathlib import Path
from typing import Final

from pyoxigraph import Store

from kg.model.errors import DiskFullError, GraphError
from kg.store.folder import reason_of

#: [bytes] that the store needs to open again, beside what its own log holds
_ROOM: Final = 2 << 20
_ATTEMPTS: Final = 20  # to open the store again, while other threads still read the old one
_PAUSE: Final = 0.05  # [s] between them
_NUMBERS: Final = (errno.ENOSPC, errno.EDQUOT)
#: as the engine and SQLite say it, whose errors have no number of the system
_WORDS: Final = ("no space left on device", "disk quota exceeded", "disk is full")


def is_disk_full(error: BaseException) -> bool:
    """Whether an error of the system, of the engine or of SQLite is one of a full disk."""
    text = str(error).lower()
    return getattr(error, "errno", None) in _NUMBERS or any(words in text for words in _WORDS)


def write_error(
    error: OSError | RuntimeError | sqlite3.Error, where: Path | str, action: str
) -> GraphError:
    """The error of a failed `action` ("cannot write ...") on the map at `where`."""
    if is_disk_full(error):
        return disk_full(where)
    reason = str(error) if isinstance(error, sqlite3.Error) else reason_of(error)
    return GraphError(f"{action}: {reason}")


def disk_full(where: Path | str) -> DiskFullError:
    """The error of a map at `where` whose disk has no space; it names the folder, not its path."""
    return DiskFullError(
        f"no space left on the disk of map {Path(where).name}; free some and retry"
    )


def has_room(path: Path) -> bool:
    """Whether the store of the map in the folder `path` has space to be opened for writing.

    Opening writes the store's own log anew.
    """
    needed = _ROOM + 2 * sum(file.stat().st_size for file in (path / "store").glob("*.log"))
    return free_space(path) >= needed


def free_space(path: Path) -> int:
    """Free space [bytes] of the disk of `path`, for this user."""
    return shutil.disk_usage(path).free


def reopened(folder: Path) -> tuple[Store, OSError | RuntimeError | None]:
    """The store in `folder`, after all references to the open one were dropped.

    After a failed write the engine refuses all further ones until it is opened again. Where that
    fails, the store is only for reading, with the reason.
    """
    for attempt in range(_ATTEMPTS):
        try:
            return Store(str(folder)), None
        except (OSError, RuntimeError) as error:
            reason = error
        if is_disk_full(reason):
            break
        gc.collect()
        if attempt:
            time.sleep(_PAUSE)
    return Store.read_only(str(folder)), reason
