"""The SQLite file of the log: tables and connections."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import quote

from kg.model.errors import HistoryError
from kg.model.regular_files import SQLITE_STEPS, StepLimit

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


def _open(
    name: str | Path, limit: StepLimit | None = None, *, uri: bool = False
) -> sqlite3.Connection:
    connection = sqlite3.connect(name, isolation_level=None, check_same_thread=False, uri=uri)
    connection.set_progress_handler(limit, SQLITE_STEPS)
    connection.execute("PRAGMA trusted_schema = OFF")  # a stranger's file calls no functions
    return connection


def connect(file: Path | None, *, read_only: bool, power_safe: bool) -> sqlite3.Connection:
    """A connection to `file` (None: in memory); raises HistoryError if it cannot be read.

    A progress handler limits its steps until the caller, who checks the tables, removes it.
    """
    if file is None:
        return _open(":memory:")
    if read_only:
        return _reader(file)
    connection = _open(file, StepLimit(file))
    # small pages, since a map of a few hundred frames has little data in each of a dozen tables
    connection.execute("PRAGMA page_size = 1024")
    connection.execute("PRAGMA journal_mode = WAL")
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
    with closing(_open(":memory:")) as fresh:
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


def _reader(file: Path) -> sqlite3.Connection:
    # SQLite's shared memory file cannot be created in a read-only folder
    for how in ("mode=ro", "immutable=1"):
        connection = _open(f"file:{quote(str(file.resolve()))}?{how}", StepLimit(file), uri=True)
        try:
            is_empty(connection)  # the first read opens the file
        except sqlite3.OperationalError:
            connection.close()
            continue
        return connection
    raise HistoryError(f"the history at {file} cannot be read; move the file away")
