"""Atomic replacement of a file: readers see the old content or the new, never a mixture."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from kg.model.errors import GraphError
from kg.store.folder import check_outside_maps, sync_folder


def write_atomically(path: Path, text: str | bytes, *, in_map: bool = False) -> None:
    """Write `text` (as UTF-8) or bytes to `path` atomically, by renaming a new file.

    Nothing is written into the folder of a map but its own files (`in_map`).

    A device or pipe (/dev/stdout) is written directly; a symbolic link is kept. Raises GraphError
    if writing fails.
    """
    if not in_map:
        check_outside_maps(path)
    data = text if isinstance(text, bytes) else text.encode("utf-8")
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(data)
            return
        path = path.resolve()
    except OSError as error:
        raise GraphError(f"cannot write {path}: {error.strerror or error}") from error
    beside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with beside.open("wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        beside.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise GraphError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        beside.unlink(missing_ok=True)
