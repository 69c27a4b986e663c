"""SQLite files of a map: the one function that opens them, and what may lie beside them.

A SQLite file is more than one file. SQLite carries out a rollback journal (``-journal``) that lies
beside a database, and deletes the file that the journal names; it applies a write-ahead log
(``-wal``) and writes an index of it (``-shm``). All databases of a map have write-ahead logs, so a
journal is never ours. https://www.sqlite.org/fileformat2.html and https://www.sqlite.org/wal.html
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import stat
import tempfile
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final, Literal

from kg.model.regular_files import SQLITE_STEPS, StepLimit, check_regular, copy_regular

JOURNAL: Final = "-journal"
LOG: Final = "-wal"
INDEX: Final = "-shm"
_Isolation = Literal["IMMEDIATE"] | None


def connect(
    path: Path | None,
    *,
    read_only: bool = False,
    live: bool = False,
    isolation_level: _Isolation = "IMMEDIATE",
    page_size: int = 4096,
    auto_vacuum: bool = False,
) -> sqlite3.Connection:
    """A connection to a database of a map (None: in memory), limited by a `StepLimit`.

    With `read_only` no file of the folder is written or made: a log that a killed process left is
    read in a private copy. With `live` too, another process of this user, or another connection of
    this process, writes the file meanwhile. Otherwise the file is made where it is missing. Raises
    OSError and sqlite3.Error, and ValueError as `check_beside`.
    """
    if path is None:
        return _connection(":memory:", None, isolation_level)
    check_beside(path, read_only=read_only)
    if read_only:
        return _reader(path, live, isolation_level)
    file = _connection(str(path), path, isolation_level)
    try:
        if file.execute("PRAGMA journal_mode").fetchone() != ("wal",):
            # first, since auto_vacuum writes: a kill leaves no journal beside the file
            file.execute("PRAGMA journal_mode = MEMORY")
            file.execute(f"PRAGMA page_size = {page_size}")
            file.execute(f"PRAGMA auto_vacuum = {'FULL' if auto_vacuum else 'NONE'}")
            file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = NORMAL")
    except BaseException:
        file.close()
        raise
    return file


def check_beside(path: Path, *, read_only: bool = False) -> None:
    """Check what SQLite would act on beside a database, whether the database exists or not.

    Raises ValueError for a rollback journal, for links, pipes and other files without content of
    their own and, where they would be written, for files with a second name (a hard link).
    """
    for suffix in ("", JOURNAL, LOG, INDEX):
        name = f"{path}{suffix}"
        try:
            status = os.lstat(name)
        except FileNotFoundError:
            continue
        if suffix == JOURNAL:
            raise ValueError(
                f"it is beside a rollback journal, {Path(name).name}, which no map has and which "
                "may delete files; without that journal it would work"
            )
        if not stat.S_ISREG(status.st_mode):
            what = "a link" if stat.S_ISLNK(status.st_mode) else "no regular file"
            raise ValueError(f"it is {what}" if not suffix else f"it is beside {name}, {what}")
        if status.st_nlink > 1 and not read_only:
            raise ValueError(f"it is one of {status.st_nlink} names of {name}; a copy would work")


def open_sqlite(
    path: Path,
    schema: Sequence[str],
    version: int,
    max_bytes: int,
    *,
    read_only: bool = False,
    live: bool = False,
    auto_vacuum: bool = False,
) -> sqlite3.Connection:
    """A database of the tables `schema`, as `connect`; with `read_only` it is checked page by page.

    A new one has its name once it is whole, so that a kill leaves none without tables. Raises as
    `connect`, OSError for a file of more than `max_bytes`, and ValueError for an empty file or
    another version.
    """
    check_beside(path, read_only=read_only)
    if path.exists():
        check_regular(path, max_bytes)
        if not path.stat().st_size:
            raise ValueError("it is empty")
    elif not read_only:
        _make(path, schema, version, auto_vacuum)
    file = connect(path, read_only=read_only, live=live, auto_vacuum=auto_vacuum)
    try:
        found = {sql for (sql,) in file.execute("SELECT sql FROM sqlite_master") if sql}
        (number,) = file.execute("PRAGMA user_version").fetchone()
        if not (found or read_only):  # an earlier release was killed here
            _fill(file, schema, version)
        elif (found, number) != ({*schema}, version):
            raise ValueError("it is of another version")
        if read_only and file.execute("PRAGMA quick_check(1)").fetchone() != ("ok",):
            raise ValueError("it is damaged inside")
    except BaseException:
        file.close()
        raise
    return file


def _make(path: Path, schema: Sequence[str], version: int, auto_vacuum: bool) -> None:
    part = path.with_name(f"{path.name}.part")
    remove_sqlite(part)  # of a process that was killed
    with closing(connect(part, auto_vacuum=auto_vacuum)) as file:
        _fill(file, schema, version)
    part.replace(path)


def _fill(file: sqlite3.Connection, schema: Sequence[str], version: int) -> None:
    for table in schema:
        file.execute(table)
    file.execute(f"PRAGMA user_version = {version}")


def unreadable(path: Path, error: Exception, without: str) -> str:
    """A line about a file beside a map that cannot be read, and what happens `without` it."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = error.strerror or reason
    elif not (isinstance(error, sqlite3.Error) or reason.startswith("it is ")):
        reason = "it is damaged inside"
    return f"cannot read {path} ({reason}): {without}"


def remove_sqlite(path: Path) -> None:
    """Remove a database with its log; raises OSError."""
    for suffix in ("", LOG, INDEX):
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def has_log(path: Path) -> bool:
    """Whether a log with transactions lies beside a database, as after a kill or in use."""
    log = Path(f"{path}{LOG}")
    return log.exists() and log.stat().st_size > 0


def _reader(path: Path, live: bool, isolation_level: _Isolation) -> sqlite3.Connection:
    address = path.absolute().as_uri()
    if live and Path(f"{path}{LOG}").exists():
        return _connection(f"{address}?mode=ro", path, isolation_level)
    if not has_log(path):  # SQLite then makes no files
        return _connection(f"{address}?immutable=1", path, isolation_level)
    folder = Path(tempfile.mkdtemp(prefix="hereabouts-"))
    try:
        copy = folder / path.name
        for suffix in ("", LOG):
            copy_regular(Path(f"{path}{suffix}"), Path(f"{copy}{suffix}"))
        file = _connection(str(copy), path, isolation_level)
        file.execute("PRAGMA locking_mode = EXCLUSIVE")  # the index of the log stays in memory
        file.execute("SELECT count(*) FROM sqlite_master").fetchone()
        file.execute("PRAGMA query_only = ON")
        return file
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # the open files stay until they are closed


def _connection(name: str, limited: Path | None, isolation_level: _Isolation) -> sqlite3.Connection:
    file = sqlite3.connect(
        name, isolation_level=isolation_level, check_same_thread=False, uri=name.startswith("file:")
    )
    if limited is not None:
        file.set_progress_handler(StepLimit(limited), SQLITE_STEPS)
    file.execute("PRAGMA trusted_schema = OFF")  # a stranger's file calls no functions
    return file
