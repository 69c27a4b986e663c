"""Files that others made: checked before they are read."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
from pathlib import Path
from typing import Final

from kg.model.platforms import NO_LINK, NO_WAIT

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
    with os.fdopen(os.open(path, os.O_RDONLY | NO_WAIT), "rb") as file:
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


def copy_regular(path: Path, to: Path) -> None:
    """Copy a regular file, and nothing that a link leads to; raises OSError."""
    # opening a pipe would wait for its other end
    source = os.open(path, os.O_RDONLY | NO_WAIT | NO_LINK)
    with os.fdopen(source, "rb") as file:
        _check(os.fstat(source), path, sys.maxsize)
        with to.open("xb") as out:
            shutil.copyfileobj(file, out, 1 << 20)


def _check(status: os.stat_result, path: Path, max_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if status.st_size > max_bytes:
        size, limit = status.st_size // 1_000_000, max_bytes // 1_000_000
        raise OSError(errno.EFBIG, f"it has {size:,} MB; up to {limit:,} would work", str(path))
