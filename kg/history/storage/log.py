"""The log: every transaction in one SQLite file beside the store, written before the store is.

A row of ``change`` is what one transaction changed about one subject; every `KEYFRAME` of them a
row of ``state`` holds all facts about it at that moment, so that replay is short. Both
lie by subject, since the past is queried by subject; ``commits`` names the subjects of each
transaction, for those who read it in order. What held before the first recorded transaction, the
floor, is a row of ``state`` too. Ontology and common sense have no floor: they are large, hardly
ever change, and are replayed backwards from their present state.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final, Protocol, Self
from weakref import WeakSet

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.errors import GraphError, HistoryError, InvalidFactError
from kg.history.replay.subject_replay import changes_since_state, facts_at, present_facts
from kg.history.storage.row_codec import (
    Coded,
    Delta,
    Term,
    decode_delta,
    decode_numbers,
    encode_delta,
    encode_numbers,
)
from kg.history.storage.schema import SCHEMA, connect, is_empty
from kg.history.storage.term_dictionary import TermDictionary
from kg.transactions import Cause, ChangeSet

KEYFRAME: Final = 16  # changes of one subject between two of its full states
BACKGROUND: Final = (NamedNode(v.ONTOLOGY_GRAPH), NamedNode(v.COMMONSENSE_GRAPH))
_FORMAT = 1
_COUNTED = 50_000  # subjects whose changes since their last full state are held in memory
_ROWS = 300  # a statement; SQLite takes 999 values at least
_TYPE = NamedNode(v.RDF_TYPE)


@dataclass(frozen=True, slots=True)
class Commit:
    """A transaction as the log lists it."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    cause: Cause


class Watcher(Protocol):
    """Receives node and number of each row that is written."""

    written: set[tuple[int, int]]


class HistoryLog:
    """An open log; safe to use from several threads.

    `floor` is the first moment it knows, `last` the last, as sequence numbers.
    """

    def __init__(self, connection: sqlite3.Connection, base: str, file: Path | None) -> None:
        self.lock = threading.RLock()
        self.file = file
        self.db = connection
        self.terms = TermDictionary(connection, base)
        self._since: dict[int, int] = {}  # changes of a node since its last full state
        self._causes: dict[tuple[str, str | None, str], int] = {}
        self.on_flush: Callable[[], None] | None = None
        self.watchers: WeakSet[Watcher] = WeakSet()  # searches for unused terms
        self.floor = self.last = 0
        self.floor_time = self.last_time = 0.0

    @classmethod
    def open(
        cls, file: Path | None, base: str, *, read_only: bool = False, power_safe: bool = False
    ) -> Self:
        """The log in `file` (None: in memory), made where there is none.

        Each transaction survives the death of the process; with `power_safe` also a power cut, for
        a disk's sync each. Raises HistoryError where the file is no log, or another map's.
        """
        try:
            connection = connect(file, read_only=read_only, power_safe=power_safe)
            log = cls(connection, base, file)
            fresh = not read_only and is_empty(connection)
            if fresh:
                connection.executescript("BEGIN;" + SCHEMA)
                connection.executemany(
                    "INSERT INTO meta VALUES (?, ?)", (("format", _FORMAT), ("base", base))
                )
                log.terms.begin()
                connection.execute("COMMIT")
            log._check(base)
            log.refresh()
        except sqlite3.Error as error:
            raise HistoryError(f"cannot read the history at {file}: {error}") from error
        return log

    @property
    def begun(self) -> bool:
        """Whether it has a floor."""
        return self._meta("floor") is not None

    def begin(self, sequence: int, time: float, quads: Iterable[Quad]) -> None:
        """Set the floor: the state of the map at `sequence`, as of `time` [s].

        Best one subject of a graph after the other, as an engine lists them: the facts about a
        million objects is not held in memory.
        """
        highest = 0
        with self.transaction():
            for (graph, subject), about in groupby(quads, key=_graph_and_subject):
                node = self.terms.node(graph, subject)
                facts = {self.terms.code(quad.predicate, quad.object) for quad in about}
                if node <= highest:  # numbers are given out in order: there were quads of it before
                    facts |= self.facts(node, sequence)
                highest = max(highest, node)
                self.put_state(node, sequence, facts)
            self.set_floor(sequence, time)
        self.refresh()

    def append(self, change: ChangeSet) -> None:
        """Record a transaction that is about to be applied.

        What the log holds of that number and later ones gives way. Raises GraphError where the file
        cannot be written, InvalidFactError for a name that is no Unicode; nothing is recorded then.
        """
        if self.last >= change.sequence:
            self.withdraw(change.sequence)
        try:
            with self.transaction():
                self._append(change)
        except sqlite3.Error as error:
            raise self._unwritable(error) from error
        except UnicodeEncodeError as error:
            raise InvalidFactError(f"who writes must have a name in Unicode: {error}") from error
        self.last, self.last_time = change.sequence, change.time

    def withdraw(self, sequence: int) -> None:
        """Forget transactions from `sequence` on: the store refused them.

        Raises GraphError where the file cannot be written.
        """
        try:
            self._withdraw(sequence)
        except sqlite3.Error as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: sqlite3.Error) -> GraphError:
        return GraphError(f"cannot write the history at {self.file}: {error}")

    def _withdraw(self, sequence: int) -> None:
        with self.transaction():
            select = "SELECT sequence, nodes FROM commits WHERE sequence >= ?"
            for number, nodes in self.db.execute(select, (sequence,)).fetchall():
                keys = [(node, number) for node in decode_numbers(nodes)]
                self.db.executemany("DELETE FROM change WHERE node = ? AND sequence = ?", keys)
                self.db.executemany("DELETE FROM state WHERE node = ? AND sequence = ?", keys)
            self.db.execute("DELETE FROM commits WHERE sequence >= ?", (sequence,))
        self.refresh()

    def commit(self, sequence: int) -> Commit | None:
        """The transaction of that number, where the log holds it."""
        return next(self.commits(sequence - 1, sequence), None)

    def commits(self, after: int, until: int) -> Iterator[Commit]:
        """Transactions numbered above `after`, up to `until`, in order."""
        for sequence, time, cause, _ in self._rows(after, until):
            yield Commit(sequence, time, cause)

    def has_author(self, name: str) -> bool:
        """Whether a transaction that is kept was made by `name`."""
        select = "SELECT 1 FROM commits JOIN cause ON cause.id = commits.cause WHERE by = ? LIMIT 1"
        with self.lock:
            return self.db.execute(select, (name,)).fetchone() is not None

    def changes(self, after: int, until: int | None = None) -> Iterator[ChangeSet]:
        """Whole change sets numbered above `after`, up to `until` or the last, in order.

        Raises HistoryError for one that is dropped meanwhile.
        """
        until = self.last if until is None else until
        for sequence, time, cause, nodes in self._rows(after, until):
            removed: list[Quad] = []
            added: list[Quad] = []
            with self.lock:
                for node in nodes:
                    select = "SELECT data FROM change WHERE node = ? AND sequence = ?"
                    row = self.db.execute(select, (node, sequence)).fetchone()
                    if row is None:
                        raise HistoryError(f"#{sequence} is no longer kept")
                    delta = decode_delta(row[0])
                    removed += self.terms.quads(node, delta.removed)
                    added += self.terms.quads(node, delta.added)
            yield ChangeSet(sequence, time, cause, tuple(added), tuple(removed))

    def touched(self, after: int, until: int) -> set[int]:
        """The nodes that transactions above `after`, up to `until`, changed."""
        with self.lock:
            select = "SELECT nodes FROM commits WHERE sequence > ? AND sequence <= ?"
            rows = self.db.execute(select, (after, until)).fetchall()
        return {node for (nodes,) in rows for node in decode_numbers(nodes)}

    def history(self, node: int) -> Iterator[tuple[int, bytes]]:
        """Sequence number and row of each change of a node, oldest first."""
        select = "SELECT sequence, data FROM change WHERE node = ? ORDER BY sequence"
        with self.lock:
            rows = self.db.execute(select, (node,)).fetchall()
        yield from rows

    def facts(self, node: int, sequence: int) -> set[Coded]:
        """All facts about a node right after the transaction `sequence`."""
        with self.lock:
            return facts_at(self.db, node, sequence)

    def nodes(self) -> list[int]:
        """Every subject of every graph there ever was."""
        with self.lock:
            return [row[0] for row in self.db.execute("SELECT id FROM node ORDER BY id")]

    def sequence_at(self, time: float) -> int:
        """The number of the last transaction at or before `time` [s]."""
        select = "SELECT sequence, time FROM commits WHERE sequence >= ? LIMIT 1"
        with self.lock:
            low, high = self.floor, self.last
            while low < high:
                middle = (low + high + 1) // 2
                row = self.db.execute(select, (middle,)).fetchone()
                if row[1] <= time:
                    low = row[0]
                else:
                    high = middle - 1
            return low

    def flush(self) -> None:
        """Move what was written into the file proper, while others may write."""
        if self.on_flush is not None:
            self.on_flush()
        if self.file is not None:
            connection = sqlite3.connect(self.file)
            try:
                connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
            except sqlite3.OperationalError:
                pass  # the next flush will do
            finally:
                connection.close()

    def close(self) -> None:
        """Close the file; idempotent."""
        with self.lock:
            self.db.close()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All that is written within, or nothing."""
        with self.lock:
            self.db.execute("BEGIN IMMEDIATE")
            try:
                yield
                self.db.execute("COMMIT")
            except BaseException:
                if self.db.in_transaction:
                    self.db.execute("ROLLBACK")
                self.forget()
                raise

    def forget(self) -> None:
        """Drop what is held in memory of the file."""
        self.terms.forget()
        self._since.clear()
        self._causes.clear()

    def refresh(self) -> None:
        """Reload the number of the last transaction."""
        self.forget()
        self.floor = int(str(self._meta("floor") or 0))
        self.floor_time = float(str(self._meta("floor time") or 0.0))
        select = "SELECT sequence, time FROM commits ORDER BY sequence DESC LIMIT 1"
        row = self.db.execute(select).fetchone()
        self.last, self.last_time = row or (self.floor, self.floor_time)

    def set_floor(self, sequence: int, time: float) -> None:
        """Record the first transaction that the log covers; within a transaction."""
        rows = ("floor", sequence), ("floor time", time)
        self.db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", rows)

    def put_state(self, node: int, sequence: int, facts: Iterable[Coded]) -> None:
        """Write all facts about a node at `sequence`; within a transaction."""
        row = node, sequence, encode_delta((), facts)
        self.db.execute("INSERT OR REPLACE INTO state VALUES (?, ?, ?)", row)

    def _append(self, change: ChangeSet) -> None:
        touched: dict[int, Delta] = {}
        node, code = self.terms.node, self.terms.code
        for side, quads in enumerate((change.removed, change.added)):
            about = None
            for subject, predicate, value, graph in quads:
                if about != (subject, graph):
                    about = subject, graph
                    sides = touched.setdefault(node(graph, subject), Delta([], []))
                sides[side].append(code(predicate, value))
        rows: list[int | bytes] = []
        for watcher in self.watchers:
            watcher.written.update((number, change.sequence) for number in touched)
        for number, (removed, added) in touched.items():
            rows += (number, change.sequence, encode_delta(removed, added))
        self._put_states(self._due(touched), touched, change.sequence)
        self._insert_changes(rows)
        stem, note = _split(change.cause)
        row = change.sequence, change.time, self._cause(change.cause, stem), note
        numbers = encode_numbers(touched)
        self.db.execute("INSERT INTO commits VALUES (?, ?, ?, ?, ?)", (*row, numbers))

    def _insert_changes(self, values: list[int | bytes]) -> None:
        # many rows a statement: between two statements another thread may take the lock
        for start in range(0, len(values), 3 * _ROWS):
            some = values[start : start + 3 * _ROWS]
            places = ", ".join(["(?, ?, ?)"] * (len(some) // 3))
            self.db.execute(f"INSERT INTO change VALUES {places}", some)

    def _due(self, nodes: Iterable[int]) -> list[int]:
        """Count one more change of each node; those of which a full state is due."""
        unknown = [node for node in nodes if node not in self._since]
        if len(self._since) + len(unknown) > _COUNTED:
            self._since = {node: self._since[node] for node in nodes if node in self._since}
        self._since.update(changes_since_state(self.db, unknown))
        due = []
        for node in nodes:
            self._since[node] += 1
            if self._since[node] >= KEYFRAME:
                self._since[node] = 0
                due.append(node)
        return due

    def _put_states(self, nodes: list[int], deltas: Mapping[int, Delta], sequence: int) -> None:
        for node, facts in present_facts(self.db, nodes).items():
            removed, added = deltas[node]
            self.put_state(node, sequence, facts.difference(removed).union(added))

    def _cause(self, cause: Cause, stem: str) -> int:
        key = cause.kind, cause.by, stem
        if key not in self._causes:
            select = "SELECT id FROM cause WHERE kind = ? AND by IS ? AND stem = ?"
            row = self.db.execute(select, key).fetchone()
            if row is None:
                insert = "INSERT INTO cause (kind, by, stem) VALUES (?, ?, ?)"
                row = (int(self.db.execute(insert, key).lastrowid or 0),)
            self._causes[key] = row[0]
        return self._causes[key]

    def _rows(self, after: int, until: int) -> Iterator[tuple[int, float, Cause, list[int]]]:
        select = (
            "SELECT sequence, time, kind, by, stem, note, nodes FROM commits "
            "JOIN cause ON cause.id = commits.cause WHERE sequence > ? AND sequence <= ? "
            "ORDER BY sequence LIMIT 256"
        )
        while True:
            with self.lock:
                rows = self.db.execute(select, (after, until)).fetchall()
            for sequence, time, kind, by, stem, note, nodes in rows:
                yield sequence, time, Cause(kind, by, stem + note), decode_numbers(nodes)
                after = sequence
            if not rows:
                return

    def _meta(self, name: str) -> object:
        with self.lock:
            select = "SELECT value FROM meta WHERE name = ?"
            row = self.db.execute(select, (name,)).fetchone()
        return row[0] if row else None

    def _check(self, base: str) -> None:
        if self._meta("format") != _FORMAT:
            raise HistoryError(
                f"the history at {self.file} is of format {self._meta('format')}, this version "
                f"reads {_FORMAT}; move the file away to begin a new one"
            )
        if self._meta("base") != base:
            raise HistoryError(
                f"the history at {self.file} is that of {self._meta('base')}, the map is {base}; "
                "put the right file there, or move it away to begin a new one"
            )


def _graph_and_subject(quad: Quad) -> tuple[Term, Term]:
    return quad.graph_name, quad.subject


def _split(cause: Cause) -> tuple[str, str]:
    """A frame's recording, which recurs, and the rest of its note."""
    if cause.kind != "frame":
        return "", cause.note
    recording, slash, frame = cause.note.rpartition("/")
    return recording + slash, frame
