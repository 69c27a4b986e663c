"""The log: a write-ahead log of all transactions in one SQLite file beside the store.

A row of ``change`` is one transaction as compressed lines of N-Quads
(`kg.history.storage.change_lines`); ``touched`` lists the transactions that changed each subject.
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
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any, Final, Self

from pyoxigraph import Quad

from kg.history.storage.change_lines import (
    ChangeLines,
    LineCodec,
    dictionary_for,
    lines_of,
    quads_of,
    subject_of,
)
from kg.history.storage.schema import SCHEMA, check_schema, check_tables, connect, is_empty
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError, InvalidFactError
from kg.model.transactions import Cause, ChangeSet
from kg.store.disk_space import write_error
from kg.store.writer_priority import yield_to_writer

BACKGROUND: Final = (v.ONTOLOGY_GRAPH, v.COMMONSENSE_GRAPH)
KEY_FRAME_AFTER: Final = 5  # size of changes before a new key frame, in sizes of the last one
STATE_LINES: Final = 500  # in a row of a key frame, or more for one large subject
_FORMAT = 2
_PAGE = 64  # transactions read at a time
_QUADS = 50_000  # serialised at a time

_TOUCHED = "sequence IN (SELECT sequence FROM touched JOIN subject ON id = subject WHERE text = ?)"


@dataclass(frozen=True, slots=True)
class Commit:
    """A transaction of the log without its change set."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    cause: Cause


class HistoryLog:
    """An open log; safe to use from several threads.

    `floor` and `last` are the numbers of the first and the last transaction in the log.
    """

    def __init__(self, connection: sqlite3.Connection, base: str, file: Path | None) -> None:
        self.lock = threading.RLock()
        self.upkeep = threading.Lock()  # held while key frames are written or transactions dropped
        self.file = file
        self.base = base
        self.db = connection
        self.codec = LineCodec(b"")
        self.on_flush: Callable[[], None] | None = None
        self.floor = self.last = 0
        self.floor_time = self.last_time = 0.0

    @classmethod
    def open(
        cls, file: Path | None, base: str, *, read_only: bool = False, power_safe: bool = False
    ) -> Self:
        """The log in `file` (None: in memory), created if necessary.

        Each transaction survives a crash of the process; with `power_safe` also a power cut, for
        the time of a disk sync. Raises HistoryError if the file is no log, or of another map.
        """
        try:
            connection = connect(file, read_only=read_only, power_safe=power_safe)
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

    @property
    def begun(self) -> bool:
        """Whether the log has a floor."""
        return self._meta("floor") is not None

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
        if self.file is None and not change.sequence % _PAGE:  # a log in memory is never flushed
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

    def commit(self, sequence: int) -> Commit | None:
        """The transaction of that number, or None."""
        return next(self.commits(sequence - 1, sequence), None)

    def time_of(self, sequence: int) -> float:
        """[s] of the last transaction up to that number, or else of the floor."""
        with self.lock:
            select = "SELECT max(time) FROM commits WHERE sequence > ? AND sequence <= ?"
            (time,) = self.db.execute(select, (self.floor, sequence)).fetchone()
        return float(self.floor_time if time is None else time)

    def commits(self, after: int, until: int) -> Iterator[Commit]:
        """Transactions numbered above `after`, up to `until`, in order."""
        select = (
            "SELECT sequence, time, kind, by, note FROM commits "
            f"WHERE sequence > ? AND sequence <= ? ORDER BY sequence LIMIT {_PAGE}"
        )
        while True:
            with self.lock:
                rows = self.db.execute(select, (after, until)).fetchall()
            for sequence, time, kind, by, note in rows:
                yield Commit(sequence, time, Cause(kind, by, note))
                after = sequence
            if not rows:
                return

    def has_author(self, name: str) -> bool:
        """Whether `name` is the author of a kept transaction."""
        with self.lock:
            select = "SELECT 1 FROM commits WHERE by = ? LIMIT 1"
            return self.db.execute(select, (name,)).fetchone() is not None

    def changes(self, after: int, until: int | None = None) -> Iterator[ChangeSet]:
        """Whole change sets numbered above `after`, up to `until` or the last, in order.

        Raises HistoryError if one is dropped meanwhile.
        """
        for commit in self.commits(after, self.last if until is None else until):
            with self.lock:
                self.check_kept(commit.sequence - 1)
                bounds = commit.sequence - 1, commit.sequence
                parts = self.change_lines(*bounds) + self.change_lines(*bounds, background=True)
            removed, added = (
                tuple(quad for part in parts for quad in quads_of(part[side])) for side in (0, 1)
            )
            yield ChangeSet(commit.sequence, commit.time, commit.cause, added, removed)

    def change_lines(
        self, after: int, until: int, *, background: bool = False
    ) -> list[ChangeLines]:
        """The changes numbered above `after`, up to `until`, in order.

        With `background`, the changes of ontology and common sense; else of all other graphs.
        """
        table = "background" if background else "change"
        select = f"SELECT data FROM {table} WHERE sequence > ? AND sequence <= ? ORDER BY sequence"
        with self.lock:
            rows = self.db.execute(select, (after, until)).fetchall()
        return [self.codec.change(data) for (data,) in rows]

    def facts(self, sequence: int, subject: bytes | None = None) -> set[bytes]:
        """The lines of all facts, or of those about `subject`, right after transaction `sequence`.

        Without ontology and common sense. Raises HistoryError if that moment is not kept.
        """
        of_subject = " AND first <= ? ORDER BY first DESC LIMIT 1" if subject else ""
        touched = f" AND {_TOUCHED}" if subject else ""
        about = [subject.decode()] if subject else []
        yield_to_writer()
        with self.lock:
            self.check_kept(sequence)
            select = "SELECT max(sequence) FROM state WHERE sequence <= ?"
            (start,) = self.db.execute(select, (sequence,)).fetchone()
            select = f"SELECT data FROM state WHERE sequence = ?{of_subject}"
            states = self.db.execute(select, (start, *about)).fetchall()
            select = f"SELECT data FROM change WHERE sequence > ? AND sequence <= ?{touched}"
            changes = self.db.execute(
                f"{select} ORDER BY sequence", (start, sequence, *about)
            ).fetchall()
        facts = {line for (data,) in states for line in self.codec.state(data)}
        if subject:
            facts = {line for line in facts if subject_of(line) == subject}
        for (data,) in changes:
            codec = self.codec
            change = codec.change_about(data, subject) if subject else codec.change(data)
            facts.difference_update(change.removed)
            facts.update(change.added)
        return facts

    def history(
        self, subject: bytes, until: int | None = None, max_count: int = -1
    ) -> list[tuple[int, ChangeLines]]:
        """The last `max_count` changes (-1: all) of a subject up to transaction `until`, in order.

        Each has the number of its transaction. Without ontology and common sense.
        """
        until = self.last if until is None else until
        select = (
            f"SELECT sequence, data FROM change WHERE sequence > ? AND sequence <= ? AND {_TOUCHED}"
            " ORDER BY sequence DESC LIMIT ?"
        )
        with self.lock:
            bounds = self.floor, until, subject.decode(), max_count
            rows = self.db.execute(select, bounds).fetchall()
        return [(number, self.codec.change_about(data, subject)) for number, data in rows[::-1]]

    def whole_history(self, subject: bytes) -> list[tuple[int, ChangeLines]]:
        """All kept changes of a subject in order, with those of ontology and common sense."""
        with self.lock:
            select = "SELECT sequence, data FROM background WHERE sequence > ?"
            rows = self.db.execute(select, (self.floor,)).fetchall()
            found = self.history(subject)
        about = ((number, self.codec.change_about(data, subject)) for number, data in rows)
        found += [(number, change) for number, change in about if any(change)]
        return sorted(found, key=lambda change: change[0])

    def subjects_under(self, prefix: str) -> list[bytes]:
        """The subjects of all kept changes whose IRI begins with `prefix`."""
        start = f"<{prefix}"
        select = "SELECT text FROM subject WHERE text >= ? AND text < ? ORDER BY text"
        with self.lock:
            rows = self.db.execute(select, (start, start + "\U0010ffff")).fetchall()
        return [text.encode() for (text,) in rows]

    def check_kept(self, sequence: int) -> None:
        """Raises HistoryError if the state after transaction `sequence` is not kept."""
        if sequence < self.floor:
            raise HistoryError(f"#{sequence} is no longer kept; the past begins at #{self.floor}")

    def sequence_at(self, time: float) -> int:
        """The number of the last transaction at or before `time` [s], or else the floor."""
        select = "SELECT sequence FROM commits WHERE time <= ? ORDER BY time DESC, sequence DESC"
        with self.lock:
            row = self.db.execute(f"{select} LIMIT 1", (time,)).fetchone()
            return max(row[0], self.floor) if row else self.floor

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
            connection = sqlite3.connect(self.file)
            try:
                connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
            except sqlite3.OperationalError:
                pass  # the next flush tries again
            finally:
                connection.close()

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

    def refresh(self) -> None:
        """Reload the numbers of the first and the last transaction."""
        with self.lock:
            self.floor = self._meta("floor") or 0
            self.floor_time = self._meta("floor time") or 0.0
            select = "SELECT sequence, time FROM commits WHERE sequence > ? ORDER BY 1 DESC LIMIT 1"
            row = self.db.execute(select, (self.floor,)).fetchone()
            self.last, self.last_time = row or (self.floor, self.floor_time)

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

    def _meta(self, name: str) -> Any:
        with self.lock:
            select = "SELECT value FROM meta WHERE name = ?"
            row = self.db.execute(select, (name,)).fetchone()
        return row[0] if row else None

    def _unwritable(self, error: sqlite3.Error) -> GraphError:
        where = self.file.parent if self.file else Path("memory")
        return write_error(error, where, f"cannot write the history at {self.file}")

    def _check(self, base: str) -> None:
        check_tables(self.db, self.file)
        if self._meta("format") != _FORMAT:
            raise HistoryError(
                f"the history at {self.file} is of format {self._meta('format')}, this version "
                f"reads {_FORMAT}; move the file away to begin a new one: the map itself stays"
            )
        check_schema(self.db, self.file)
        if self._meta("base") != base:
            raise HistoryError(
                f"the history at {self.file} is that of {self._meta('base')}, the map is {base}; "
                "put the right file there, or move it away to begin a new one"
            )
