"""The SQLite file of the log: tables and connections."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final

from kg.model import sqlite_files
from kg.model.errors import HistoryError

SCHEMA: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value) WITHOUT ROWID;
CREATE TABLE commits (
    sequence INTEGER PRIMARY KEY, time REAL NOT NULL, kind TEXT NOT NULL, by TEXT,
    note TEXT NOT NULL
);
CREATE INDEX commit_time ON commits (time);
CREATE TABLE change (sequence INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE background (sequence INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE state (
    sequence INTEGER, first TEXT, data BLOB NOT NULL, PRIMARY KEY (sequence, first)
) WITHOUT ROWID;
CREATE TABLE subject (id INTEGER PRIMARY KEY, text TEXT NOT NULL UNIQUE);
CREATE TABLE touched (
    subject INTEGER, sequence INTEGER, PRIMARY KEY (subject, sequence)
) WITHOUT ROWID;
"""


def connect(
    file: Path | None, *, read_only: bool, live: bool, power_safe: bool
) -> sqlite3.Connection:
    """A connection to `file` (None: in memory); raises HistoryError for a file that is refused.

    A progress handler limits its steps until the caller, who checks the tables, removes it.
    """
    try:
        # small pages, since a map of a few hundred frames has little data in each of a dozen tables
        connection = sqlite_files.connect(
            file, read_only=read_only, live=live, isolation_level=None, page_size=1024
        )
    except (ValueError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise HistoryError(f"cannot read the history at {file}: {reason}") from error
    if file is not None and not read_only:
        connection.execute(f"PRAGMA synchronous = {'FULL' if power_safe else 'NORMAL'}")
        # the store's flush thread checkpoints; this limit only applies if it falls behind
        connection.execute("PRAGMA wal_autocheckpoint = 20000")
    return connection


def check_tables(connection: sqlite3.Connection, file: Path | None) -> None:
    """Raise HistoryError if the file holds views, triggers or virtual tables: they run code."""
    foreign = connection.execute(
        "SELECT name FROM sqlite_master WHERE type NOT IN ('table', 'index') "
        "OR sql LIKE 'CREATE VIRTUAL%' ORDER BY name"
    ).fetchone()
    if foreign:
        raise _not_ours(file, foreign[0])


def check_schema(connection: sqlite3.Connection, file: Path | None) -> None:
    """Raise HistoryError if the tables differ from those that hereabouts makes."""
    with closing(sqlite_files.connect(None)) as fresh:
        fresh.executescript(SCHEMA)
        differing = _entries(connection) ^ _entries(fresh)
    if differing:
        raise _not_ours(file, min(differing)[0])


def _entries(connection: sqlite3.Connection) -> set[tuple[str, str]]:
    statement = "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL"
    return set(connection.execute(statement))


def _not_ours(file: Path | None, name: str) -> HistoryError:
    return HistoryError(
        f"the history at {file} was not made by hereabouts: {name!r} is no table of a history; "
        "move the file away to begin a new one"
    )


def is_empty(connection: sqlite3.Connection) -> bool:
    """Whether the file has no tables yet."""
    return not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
