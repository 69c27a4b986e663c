"""The folder of a map: Oxigraph's store, the lock, files replaced atomically, space of the disk."""

from __future__ import annotations

import contextlib
import errno
import gc
import glob
import os
import shutil
import sqlite3
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pyoxigraph import Store

from kg.model.errors import DiskFullError, GraphError, MapBusyError, MapNotFoundError
from kg.model.platforms import NO_LINK, NO_WAIT, lock, open_folder, user
from kg.model.regular_files import copy_regular, read_text
from kg.model.sqlite_files import JOURNAL, LOG

_MAX_NAME: Final = 200  # bytes of the name under which a writer serves


def is_url(address: object) -> bool:
    """Whether the address of a map names a server, not a folder."""
    return isinstance(address, str) and address.lower().startswith(("http://", "https://"))


def locked(file: Path, path: Path, *, shared: bool) -> int:
    """Descriptor that holds the lock of the map at `path`, by its lock file `file`.

    A reader makes no lock file: it locks the folder of a copied map that has none. Raises
    MapBusyError while another process holds the lock.
    """
    try:
        descriptor = _open_lock(file, shared)
        try:
            lock(descriptor, shared=shared)
            if not shared:
                _check_unread(file.parent)
        except BaseException:
            os.close(descriptor)
            raise
    except BlockingIOError as error:
        what = "is being written" if shared else "is already open"
        raise MapBusyError(
            f"the map at {path} {what}, here or in another process; end that first, or give the "
            "address of its `hereabouts serve`"
        ) from error
    except OSError as error:
        raise GraphError(f"cannot lock the map at {path}: {reason_of(error)}") from error
    return descriptor


def announce(path: Path, name: str) -> None:
    """Write into the lock file of a map where its writer serves; raises OSError."""
    how = os.O_WRONLY | NO_LINK | NO_WAIT
    with os.fdopen(os.open(path / "lock", how), "wb") as file:
        if os.fstat(file.fileno()).st_nlink > 1:
            raise OSError(errno.EMLINK, "the lock file has a second name")
        file.truncate()
        file.write(name.encode())


def announced(path: Path) -> str | None:
    """Announcement of the writer of a map; None in a folder of another user."""
    file = path / "lock"
    try:
        if {path.stat().st_uid, file.lstat().st_uid} != {user()}:
            return None
        return read_text(file, max_bytes=_MAX_NAME) or None
    except (OSError, UnicodeDecodeError):
        return None


def _open_lock(file: Path, shared: bool) -> int:
    how = NO_LINK | NO_WAIT
    if not shared:
        return os.open(file, os.O_RDWR | os.O_CREAT | how, 0o666)
    with contextlib.suppress(FileNotFoundError):
        return os.open(file, os.O_RDONLY | how)
    folder = open_folder(file.parent)
    return os.open(file, os.O_RDWR | os.O_CREAT | how, 0o666) if folder is None else folder


def _check_unread(folder: Path) -> None:
    """Raise BlockingIOError while a reader has locked the folder, for want of a lock file."""
    descriptor = open_folder(folder)
    if descriptor is None:
        return
    try:
        lock(descriptor)
    except BlockingIOError:
        raise
    except OSError:
        pass  # some network file systems lock no folders
    finally:
        os.close(descriptor)


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
        made = f"`hereabouts map RECORDING --into {path}` makes one"
        raise MapNotFoundError(f"no map at {path}: nothing is there; {made}")
    if not path.is_dir():
        raise MapNotFoundError(f"no map at {path}: that is a file; a map is a folder with store/")
    if not (path / "store" / "CURRENT").is_file():
        raise MapNotFoundError(f"no map at {path}: that folder holds no store/, so it is none")
    for folder in (path, path / "store"):
        _check_entries(folder, path)


def _check_entries(folder: Path, path: Path) -> None:
    """Raise GraphError for what no map holds: links lead elsewhere, pipes and devices block.

    A rollback journal lets SQLite change its database and delete the file that it names.
    """
    try:
        entries = [*os.scandir(folder)]
    except OSError as error:
        raise GraphError(f"cannot read the map at {path}: {reason_of(error)}") from error
    for entry in entries:
        usual = entry.is_file(follow_symlinks=False) or entry.is_dir(follow_symlinks=False)
        if usual and not entry.name.endswith(JOURNAL):
            continue
        what = "a rollback journal, which may delete files of yours"
        if not usual:
            what = "a link" if entry.is_symlink() else "a pipe, a socket or a device"
        name = os.path.relpath(entry.path, path)
        raise GraphError(
            f"the map at {path} holds {name}, {what}: no map has one, so nothing was read; "
            "if you trust the map, move that away"
        )


def check_outside_maps(path: Path) -> None:
    """Raise GraphError where the output `path` is the folder of a map or lies inside one."""
    resolved = path.resolve()
    for folder in (resolved, *resolved.parents):
        if (folder / "store" / "CURRENT").exists():
            raise GraphError(
                f"{path} is inside the folder of the map {folder.name}; choose a path outside of "
                f"it, for example {resolved.name}"
            )


def copy_files(path: Path, to: Path) -> None:
    """Copy store and history of a map to the new folder `to`; the locked map stays as it is.

    Tables of the store are never rewritten, so that hard links of them do where they can be made.
    """
    (to / "store").mkdir(parents=True)
    for file in (path / "store").iterdir():
        with contextlib.suppress(OSError, NotImplementedError):
            if file.suffix == ".sst":
                os.link(file, to / "store" / file.name, follow_symlinks=False)
                continue
        if file.is_file() and file.name != "LOCK":
            copy_regular(file, to / "store" / file.name)
    for file in path.glob("history.sqlite*"):
        if file.suffix in (".sqlite", f".sqlite{LOG}"):
            copy_regular(file, to / file.name)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[tuple[Path, int]]:
    """A folder that becomes `path` after the block, and the descriptor of its lock.

    It is made beside `path` and then renamed, so that a killed process leaves no incomplete map,
    and its name is on the disk. Nothing is left after a failure. Raises OSError.
    """
    above = [at.parent for at in (path.parent, *path.parent.parents) if not at.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_abandoned(path)
    building = path.parent / f".{path.name}.new-{uuid.uuid4().hex}"
    building.mkdir()
    descriptor = locked(building / "lock", path, shared=False)
    try:
        yield building, descriptor
        sync_folder(building)
        building.rename(path)
        for folder in (path.parent, *above):
            sync_folder(folder)
    except BaseException:
        os.close(descriptor)
        shutil.rmtree(building, ignore_errors=True)
        raise


def sync_folder(folder: Path) -> None:
    """Let the names in `folder` survive a power cut: new, renamed and removed ones.

    Does nothing where the file system cannot sync a folder.
    """
    with contextlib.suppress(OSError):
        descriptor = open_folder(folder)
        if descriptor is None:
            return
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def remove_abandoned(path: Path, kind: str = "new") -> None:
    """Remove the folders ``.<name>.<kind>-*`` beside `path` that killed processes left behind.

    Their lock files are not locked.
    """
    for folder in path.parent.glob(f".{glob.escape(path.name)}.{kind}-*"):
        try:
            descriptor = os.open(folder / "lock", os.O_RDWR | NO_LINK | NO_WAIT)
        except OSError:
            continue
        try:
            lock(descriptor)
            shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            continue
        finally:
            os.close(descriptor)


def reason_of(error: OSError | RuntimeError) -> str:
    """The message of an error of the file system or of RocksDB, in one line."""
    reason = error.strerror if isinstance(error, OSError) else None
    return " ".join((reason or str(error)).split())


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
