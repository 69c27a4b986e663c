"""The log: a write-ahead log of all transactions in one SQLite file beside the store.

A row of ``change`` is one transaction as compressed lines of N-Quads
(`kg.history.storage.log_reader`); ``touched`` lists the transactions that changed each subject.
The rows of ``state`` with one number are a key frame: all facts at one moment, so that replay is
short. The first key frame, the floor, has the facts before the first recorded transaction. Changes
of the ontology and of common sense are rows of ``background``. Those graphs are large and hardly
ever change, so they have no key frames: their past is the present state with later changes undone.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from itertools import groupby, islice
from pathlib import Path
from typing import Final, Self

from pyoxigraph import Quad

from kg.history.storage.log_reader import (
    PAGE,
    Commit,
    LineCodec,
    LogReader,
    dictionary_for,
    lines_of,
    subject_of,
)
from kg.model import sqlite_files
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError, InvalidFactError
from kg.model.transactions import ChangeSet
from kg.store.folder import write_error

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


BACKGROUND: Final = (v.ONTOLOGY_GRAPH, v.COMMONSENSE_GRAPH)
#: graphs without key frames; inferred types follow from the other graphs, so no change has them
WITHOUT_KEY_FRAMES: Final = (*BACKGROUND, v.INFERRED_GRAPH)
KEY_FRAME_AFTER: Final = 5  # size of changes before a new key frame, in sizes of the last one
STATE_LINES: Final = 500  # in a row of a key frame, or more for one large subject
_FORMAT = 2
_QUADS = 50_000  # serialised at a time


class HistoryLog(LogReader):
    """An open log, read and written; safe to use from several threads."""

    def __init__(self, connection: sqlite3.Connection, base: str, file: Path | None) -> None:
        super().__init__(connection, base, file)
        self.upkeep = threading.Lock()  # held while key frames are written or transactions dropped
        self.on_flush: Callable[[], None] | None = None

    @classmethod
    def open(
        cls,
        file: Path | None,
        base: str,
        *,
        read_only: bool = False,
        live: bool = False,
        power_safe: bool = False,
    ) -> Self:
        """The log in `file` (None: in memory), created if necessary.

        With `read_only` nothing is written; `live` says that another process writes the log.

        Each transaction survives a crash of the process; with `power_safe` also a power cut, for
        the time of a disk sync. Raises HistoryError if the file is no log, or of another map.
        """
        try:
            connection = connect(file, read_only=read_only, live=live, power_safe=power_safe)
            log = cls(connection, base, file)
            if not read_only and is_empty(connection):
                connection.executescript("BEGIN;" + SCHEMA)
                meta = {"format": _FORMAT, "base": base, "dictionary": dictionary_for(base)}
                connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
                connection.execute("COMMIT")
            log._check(base)
            log.codec = LineCodec(log._meta("dictionary"))
            log.refresh()
            connection.set_progress_handler(None, 0)
        except sqlite3.Error as error:
            raise HistoryError(f"cannot read the history at {file}: {error}") from error
        return log

    def begin(self, sequence: int, time: float, quads: Iterable[Quad]) -> None:
        """Set the floor: the quads of the map after transaction `sequence`, at `time` [s].

        The quads are sorted on disk, which needs little memory for any map.
        """
        rest = iter(quads)
        with self.transaction():
            self.db.execute("CREATE TEMP TABLE line (text BLOB)")
            while some := [*islice(rest, _QUADS)]:
                self.db.executemany("INSERT INTO line VALUES (?)", zip(lines_of(some), strict=True))
            lines = self.db.execute("SELECT text FROM line ORDER BY text")
            self._insert_state(self.state_rows(sequence, (line for (line,) in lines)))
            self.db.execute("DROP TABLE line")
            self.set_floor(sequence, time)
        self.refresh()

    def append(self, change: ChangeSet) -> None:
        """Record a transaction before the store applies it; replaces that number and later ones.

        Raises:
            GraphError: the file cannot be written; nothing is recorded.
            InvalidFactError: the name of the author is not valid Unicode; nothing is recorded.
        """
        if self.last >= change.sequence:
            self.withdraw(change.sequence)
        rows = self._rows_of(change)
        try:
            with self.transaction():
                self._insert(change, rows)
        except sqlite3.Error as error:
            raise self._unwritable(error) from error
        except UnicodeEncodeError as error:
            raise InvalidFactError(f"who writes must have a name in Unicode: {error}") from error
        self.last, self.last_time = change.sequence, change.time
        if self.file is None and not change.sequence % PAGE:  # a log in memory is never flushed
            self.write_key_frame()

    def withdraw(self, sequence: int) -> None:
        """Remove the transactions from `sequence` on, which the store rejected.

        Raises GraphError if the file cannot be written.
        """
        try:
            with self.transaction():
                self.delete(sequence, self.last)
                unbegun = "DELETE FROM state WHERE sequence >= ? AND sequence > ?"
                self.db.execute(unbegun, (sequence, self.floor))
            self.refresh()
        except sqlite3.Error as error:
            raise self._unwritable(error) from error

    def flush(self) -> None:
        """Write a due key frame, and move the changes from the WAL into the main file.

        Other threads may write meanwhile. Raises GraphError if the file cannot be written.
        """
        try:
            if self.on_flush is not None:
                self.on_flush()
            self.write_key_frame()
        except sqlite3.Error as error:
            raise self._unwritable(error) from error
        if self.file is not None:
            other = sqlite_files.connect(self.file)
            with closing(other), suppress(sqlite3.OperationalError):  # the next flush tries again
                other.execute("PRAGMA wal_checkpoint(PASSIVE)")

    def write_key_frame(self) -> None:
        """Write a key frame if the changes since the last one are large."""
        with self.upkeep:
            sequence = self.last - 1  # the last one may still be withdrawn
            if self._is_key_frame_due(sequence):
                rows = [*self.state_rows(sequence, sorted(self.facts(sequence)))]
                with self.transaction():
                    self._insert_state(rows)

    def state_rows(self, sequence: int, lines: Iterable[bytes]) -> Iterator[tuple[int, str, bytes]]:
        """The rows of a key frame from its sorted lines."""
        first, some = b"", list[bytes]()
        for subject, about in groupby(lines, key=subject_of):
            if len(some) >= STATE_LINES:
                yield sequence, first.decode(), self.codec.encode(some)
                first, some = subject, []
            some += about
        yield sequence, first.decode(), self.codec.encode(some)

    def raise_floor(self, commit: Commit) -> None:
        """Make `commit` the floor; older transactions are still stored, but not read."""
        rows = [*self.state_rows(commit.sequence, sorted(self.facts(commit.sequence)))]
        with self.lock:
            with self.transaction():
                self._insert_state(rows)
                self.db.execute("DELETE FROM state WHERE sequence < ?", (commit.sequence,))
                self.set_floor(commit.sequence, commit.time)
            self.refresh()

    def move_to(self, file: Path) -> None:
        """Read the same history in another file, which is written meanwhile."""
        with self.lock:
            if file != self.file:
                former, self.db = (
                    self.db,
                    connect(file, read_only=True, live=True, power_safe=False),
                )
                self.db.set_progress_handler(None, 0)
                self.file = file
                former.close()

    def close(self) -> None:
        """Close the file; idempotent."""
        with self.lock:
            self.db.close()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """An atomic transaction of SQLite for the length of a block."""
        with self.lock:
            self.db.execute("BEGIN IMMEDIATE")
            try:
                yield
                self.db.execute("COMMIT")
            except BaseException:
                if self.db.in_transaction:
                    self.db.execute("ROLLBACK")
                raise

    def set_floor(self, sequence: int, time: float) -> None:
        """Store the number and time [s] of the floor; within `transaction`."""
        rows = ("floor", sequence), ("floor time", time)
        self.db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)

    def delete(self, first: int, last: int) -> None:
        """Delete the transactions from `first` to `last`; within `transaction`."""
        changes = self.change_lines(first - 1, last)
        found = {subject_of(line) for change in changes for side in change for line in side}
        subjects = json.dumps([subject.decode() for subject in found])
        for table in ("commits", "change", "background"):
            self.db.execute(f"DELETE FROM {table} WHERE sequence BETWEEN ? AND ?", (first, last))
        these = "(SELECT subject.id FROM json_each(?) CROSS JOIN subject ON text = value)"
        self.db.execute(
            f"DELETE FROM touched WHERE subject IN {these} AND sequence BETWEEN ? AND ?",
            (subjects, first, last),
        )
        self.db.execute(
            f"DELETE FROM subject WHERE id IN {these} "
            "AND NOT EXISTS (SELECT 1 FROM touched WHERE touched.subject = id)",
            (subjects,),
        )

    def _rows_of(self, change: ChangeSet) -> dict[str, list[list[bytes]]]:
        """Removed and added lines by table."""
        rows: dict[str, list[list[bytes]]] = {}
        for table, is_background in (("change", False), ("background", True)):
            sides = [
                lines_of(quad for quad in quads if (quad.graph_name in BACKGROUND) == is_background)
                for quads in (change.removed, change.added)
            ]
            if any(sides):
                rows[table] = sides
        return rows

    def _insert(self, change: ChangeSet, rows: dict[str, list[list[bytes]]]) -> None:
        cause = change.cause
        row = change.sequence, change.time, cause.kind, cause.by, cause.note
        self.db.execute("INSERT INTO commits VALUES (?, ?, ?, ?, ?)", row)
        for table, sides in rows.items():
            data = self.codec.encode(*sides)
            self.db.execute(f"INSERT INTO {table} VALUES (?, ?)", (change.sequence, data))
        found = {subject_of(line) for side in rows.get("change", ()) for line in side}
        subjects = json.dumps([subject.decode() for subject in sorted(found)])
        # one statement for all subjects: between two, another thread may take the interpreter lock
        self.db.execute(
            "INSERT OR IGNORE INTO subject (text) SELECT value FROM json_each(?)", (subjects,)
        )
        self.db.execute(
            "INSERT INTO touched SELECT subject.id, ? FROM json_each(?) "
            "CROSS JOIN subject ON text = value",
            (change.sequence, subjects),
        )

    def _insert_state(self, rows: Iterable[tuple[int, str, bytes]]) -> None:
        self.db.executemany("INSERT OR REPLACE INTO state VALUES (?, ?, ?)", rows)

    def _is_key_frame_due(self, sequence: int) -> bool:
        with self.lock:
            select = "SELECT sequence, sum(length(data)) FROM state GROUP BY 1 ORDER BY 1 DESC"
            start, size = self.db.execute(f"{select} LIMIT 1").fetchone() or (sequence, 0)
            select = "SELECT sum(length(data)) FROM change WHERE sequence > ? AND sequence <= ?"
            (written,) = self.db.execute(select, (start, sequence)).fetchone()
        return (written or 0) > KEY_FRAME_AFTER * size

    def _unwritable(self, error: sqlite3.Error) -> GraphError:
        where = self.file.parent if self.file else Path("memory")
        return write_error(error, where, f"cannot write the history at {self.file}")

    def _check(self, base: str) -> None:
        check_tables(self.db, self.file)
        found = self._meta("format")
        if isinstance(found, int) and found > _FORMAT:
            raise HistoryError(
                f"a later version of hereabouts wrote the history at {self.file}: it is of format "
                f"{found}, this version reads {_FORMAT}; that version reads the map"
            )
        if found != _FORMAT:
            raise HistoryError(
                f"the history at {self.file} is of format {found}, this version "
                f"reads {_FORMAT}; move the file away to begin a new one: the map itself stays"
            )
        check_schema(self.db, self.file)
        if self._meta("base") != base:
            raise HistoryError(
                f"the history at {self.file} is that of {self._meta('base')}, the map is {base}; "
                "put the right file there, or move it away to begin a new one"
            )
