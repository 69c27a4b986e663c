"""Files that others made: checked before they are read."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Final

MAX_BYTES: Final = 1 << 29  # of a file that is read whole


def check_regular(path: Path, max_bytes: int = MAX_BYTES) -> None:
    """Check that a file can be read whole: devices and pipes have no end.

    Raises:
        OSError: the file is missing, is no regular file, or has more than `max_bytes`.
    """
    status = path.stat()
    if not path.is_file():
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if status.st_size > max_bytes:
        size, limit = status.st_size // 1_000_000, max_bytes // 1_000_000
        raise OSError(errno.EFBIG, f"it has {size:,} MB; up to {limit:,} would work", str(path))
