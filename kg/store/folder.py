"""The folder of a map: ``store/`` with Oxigraph's files, and the lock file ``lock``."""

from __future__ import annotations

import fcntl
import glob
import os
import shutil
from pathlib import Path

from kg.model.errors import GraphError, MapBusyError, MapNotFoundError


def locked(file: Path, path: Path, *, shared: bool) -> int:
    """Descriptor of the lock file `file` that holds the lock of the map at `path`.

    Raises MapBusyError while another process holds the lock.
    """
    try:
        descriptor = _open_lock(file, shared)
    except OSError as error:
        raise GraphError(f"cannot lock the map at {path}: {reason_of(error)}") from error
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        what = "is being written" if shared else "is already open"
        raise MapBusyError(
            f"the map at {path} {what}, here or in another process; close it there first, "
            "work on a copy of the folder, or give the address of its `hereabouts serve`"
        ) from error
    return descriptor


def _open_lock(file: Path, shared: bool) -> int:
    if shared:
        try:
            return os.open(file, os.O_RDONLY)
        except FileNotFoundError:
            pass  # a copied map may have no lock file
    return os.open(file, os.O_RDWR | os.O_CREAT, 0o666)


def check_vacant(path: Path) -> None:
    """Raises GraphError if something exists at `path`."""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        what = "there is a map" if (path / "store" / "CURRENT").is_file() else "something lies"
        raise GraphError(f"{what} at {path} already; open it, or create at a path that is free")


def check_is_map(path: Path) -> None:
    """Raises MapNotFoundError if there is no map at `path`."""
    if not path.exists():
        raise MapNotFoundError(f"no map at {path}: nothing is there; create a map first")
    if not path.is_dir():
        raise MapNotFoundError(f"no map at {path}: that is a file; a map is a folder with store/")
    if not (path / "store" / "CURRENT").is_file():
        raise MapNotFoundError(f"no map at {path}: that folder holds no store/; create a map first")


def made_folder(folder: Path) -> list[Path]:
    """Create a folder and its parents; returns the folders that contain a new one."""
    new = [at for at in (folder, *folder.parents) if not at.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return [at.parent for at in new]


def remove_abandoned(path: Path, kind: str = "new") -> None:
    """Remove the folders ``.<name>.<kind>-*`` beside `path` that killed processes left behind.

    Their lock files are not locked.
    """
    for folder in path.parent.glob(f".{glob.escape(path.name)}.{kind}-*"):
        try:
            lock = os.open(folder / "lock", os.O_RDWR)
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            continue
        finally:
            os.close(lock)


def reason_of(error: OSError | RuntimeError) -> str:
    """The message of an error of the file system or of RocksDB, in one line."""
    reason = error.strerror if isinstance(error, OSError) else None
    return " ".join((reason or str(error)).split())
