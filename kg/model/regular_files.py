"""Files that others made: checked before they are read."""

from __future__ import annotations

import errno
import os
import sqlite3
import stat
from pathlib import Path
from typing import Final

MAX_BYTES: Final = 1 << 29  # of a file that is read whole
SQLITE_STEPS: Final = 1_000_000  # of SQLite's machine between two calls of a `StepLimit`
_MIN_STEPS, _STEPS_PER_BYTE = 20_000_000, 10  # takes about a second, longer for large files


def check_regular(path: Path, max_bytes: int = MAX_BYTES) -> None:
    """Check that a file can be read whole: devices and pipes have no end.

    Raises:
        OSError: the file is missing, is no regular file, or has more than `max_bytes`.
    """
    _check(path.stat(), path, max_bytes)


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a regular file of up to `max_bytes`; raises OSError as `check_regular`."""
    check_regular(path, max_bytes)  # some devices act as they are opened
    # another may have put a pipe there meanwhile, which blocks
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        status = os.fstat(file.fileno())
        _check(status, path, max_bytes)
        return file.read(status.st_size)


def read_text(path: Path, encoding: str = "utf-8", max_bytes: int = MAX_BYTES) -> str:
    """The text of a regular file; raises OSError as `check_regular`, and UnicodeDecodeError."""
    return read_bytes(path, max_bytes).decode(encoding)


class StepLimit:
    """Progress handler for each SQLITE_STEPS of a SQLite connection to a file of others.

    It interrupts once all statements since `reset` together took more steps than such a file can
    need: the tables of a stranger may have no end.
    """

    def __init__(self, path: Path) -> None:
        size = path.stat().st_size if path.exists() else 0
        self._calls = (_MIN_STEPS + _STEPS_PER_BYTE * size) // SQLITE_STEPS
        self.reset()

    def reset(self) -> None:
        """Begin to count anew."""
        self._left = self._calls

    def __call__(self) -> bool:
        """Whether SQLite is to interrupt."""
        self._left -= 1
        return self._left < 0


def open_sqlite(
    path: Path, schema: str, version: int, max_bytes: int, *, read_only: bool = False
) -> sqlite3.Connection:
    """A SQLite file of one table beside a map, made where it is missing; limited by a `StepLimit`.

    With `read_only` it is checked page by page and stays as it is. Raises OSError as
    `check_regular`, sqlite3.Error, and ValueError for a link, an empty file or another version.
    """
    if path.is_symlink():
        raise ValueError("it is a link")
    if path.exists():
        check_regular(path, max_bytes)
        if not path.stat().st_size:
            raise ValueError("it is empty")
    if read_only:
        return _read_only(path, schema, version)
    file = sqlite3.connect(path, isolation_level="IMMEDIATE", check_same_thread=False)
    try:
        file.execute("PRAGMA trusted_schema = OFF")
        file.set_progress_handler(StepLimit(path), SQLITE_STEPS)
        found = [sql for (sql,) in file.execute("SELECT sql FROM sqlite_master") if sql]
        (number,) = file.execute("PRAGMA user_version").fetchone()
        if found and (found, number) != ([schema], version):
            raise ValueError("it is of another version")
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = NORMAL")
        if not found:
            file.execute(schema)
            file.execute(f"PRAGMA user_version = {version}")
    except BaseException:
        file.close()
        raise
    return file


def connect_read_only(path: Path) -> sqlite3.Connection:
    """A connection that reads a SQLite file; without a log beside it, it makes no files there."""
    log = Path(f"{path}-wal")
    options = "mode=ro" if log.exists() and log.stat().st_size else "immutable=1"
    uri = f"{path.absolute().as_uri()}?{options}"
    file = sqlite3.connect(uri, uri=True, check_same_thread=False)
    file.execute("PRAGMA trusted_schema = OFF")
    return file


def _read_only(path: Path, schema: str, version: int) -> sqlite3.Connection:
    file = connect_read_only(path)
    try:
        file.set_progress_handler(StepLimit(path), SQLITE_STEPS)
        found = [sql for (sql,) in file.execute("SELECT sql FROM sqlite_master") if sql]
        (number,) = file.execute("PRAGMA user_version").fetchone()
        if (found, number) != ([schema], version):
            raise ValueError("it is of another version")
        (fault,) = file.execute("PRAGMA quick_check(1)").fetchone()
        if fault != "ok":
            raise ValueError("it is damaged inside")
    except BaseException:
        file.close()
        raise
    return file


def unreadable(path: Path, error: Exception, without: str) -> str:
    """A line about a file beside a map that cannot be read, and what happens `without` it."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = error.strerror or reason
    elif not (isinstance(error, sqlite3.Error) or reason.startswith("it is ")):
        reason = "it is damaged inside"
    return f"cannot read {path} ({reason}): {without}"


def remove_sqlite(path: Path) -> None:
    """Remove a SQLite file with its log; raises OSError."""
    for suffix in ("", "-wal", "-shm"):
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def _check(status: os.stat_result, path: Path, max_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if status.st_size > max_bytes:
        size, limit = status.st_size // 1_000_000, max_bytes // 1_000_000
        raise OSError(errno.EFBIG, f"it has {size:,} MB; up to {limit:,} would work", str(path))
