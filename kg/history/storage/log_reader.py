"""Reading of the log: transactions, changes, and the facts at any kept moment."""

from __future__ import annotations

import sqlite3
import sys
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, Final, NamedTuple

from pyoxigraph import Quad, RdfFormat, parse, serialize

from kg.model import vocabulary as v
from kg.model.errors import HistoryError, InvalidFactError
from kg.model.transactions import Cause, ChangeSet
from kg.store.scheduling import check_time, yield_to_writer

MAX_TEXT: Final = 1 << 29  # [bytes] of a row, decompressed
_LARGE: Final = 1 << 20  # [bytes] of a row, from which on it is compressed quickly
_REMEDY: Final = "move history.sqlite away to begin a new one"
_SPACE: Final = ord(" ")
_DOUBLES: Final = (v.Y_MIN, v.X_MAX, v.X_MIN, v.BELIEF, v.HEADING, v.SCORE, v.Z, v.Y, v.X)
_INTEGERS: Final = (v.NEXT_OBJECT, v.VIEW_COUNT, v.FRAMES_APPLIED, v.OBSERVATION_COUNT)
_TIMES: Final = (v.SOSA_RESULT_TIME, v.FIRST_SEEN, v.LAST_SEEN)
_TEXTS: Final = (v.BOX, v.FRAME, v.MODEL, v.LAST_FRAME, v.RDFS_LABEL)
_NODES: Final = (
    *(v.SOSA_FEATURE, v.FROM_RECORDING, v.EXPLAINED_BY, v.HAS_BELIEF, v.OF_CATEGORY),
    *(v.IN_PLACE, v.RDF_TYPE.value),
)


class ChangeLines(NamedTuple):
    """Lines of one change set, or of its part about one subject."""

    removed: list[bytes]
    added: list[bytes]


class LineCodec:
    """Compresses and decompresses blocks of lines with a preset dictionary.

    Reading raises HistoryError for what is damaged or larger than `MAX_TEXT`.
    """

    def __init__(self, dictionary: bytes) -> None:
        self._dictionary = dictionary

    def encode(self, *blocks: Iterable[bytes]) -> bytes:
        """Blocks of lines, sorted and compressed.

        Raises InvalidFactError for more than `MAX_TEXT` bytes.
        """
        text = b"\n\n".join(_packed(block) for block in blocks)
        # others wait while a large text is compressed; negative window bits leave out zlib's header
        level = 9 if len(text) < _LARGE else 3
        deflate = zlib.compressobj(level, zlib.DEFLATED, -zlib.MAX_WBITS, 9, zdict=self._dictionary)
        if len(text) > MAX_TEXT:
            raise InvalidFactError(
                f"a transaction of {len(text):,} bytes as N-Quads; at most {MAX_TEXT:,} would work"
            )
        return deflate.compress(text) + deflate.flush()

    def state(self, data: bytes) -> list[bytes]:
        """The lines of a single block."""
        return _unpacked(self._text(data))

    def change(self, data: bytes) -> ChangeLines:
        """The lines of a change set."""
        removed, _, added = self._text(data).partition(b"\n\n")
        return ChangeLines(_unpacked(removed), _unpacked(added))

    def change_about(self, data: bytes, subject: bytes) -> ChangeLines:
        """The lines of a change set about `subject`, a term as in N-Quads."""
        removed, _, added = self._text(data).partition(b"\n\n")
        return ChangeLines(_about(removed, subject), _about(added, subject))

    def _text(self, data: bytes) -> bytes:
        inflate = zlib.decompressobj(-zlib.MAX_WBITS, zdict=self._dictionary)
        try:
            text = inflate.decompress(data, MAX_TEXT)
        except zlib.error as error:
            raise HistoryError(f"the history is damaged ({error}); {_REMEDY}") from error
        if inflate.unconsumed_tail:
            raise HistoryError(f"a row of the history has more than {MAX_TEXT:,} bytes; {_REMEDY}")
        if not inflate.eof:
            raise HistoryError(f"the history is damaged (a row is cut off); {_REMEDY}")
        return text


def dictionary_for(base: str) -> bytes:
    """The preset dictionary of a map's log: typical lines, the most frequent last."""
    graph, thing = f"{v.MAP_GRAPH} .\n", f"<{base}object/1>"
    lines = [
        *(f"{thing} <{name}> <{base}place/1> {graph}" for name in _NODES),
        *(f'{thing} <{name}> "frame-0000" {graph}' for name in _TEXTS),
        *(f'{thing} <{name}> "2026-01-01T00:00:00Z"^^<{v.XSD}dateTime> {graph}' for name in _TIMES),
        *(f'{thing} <{name}> "1"^^<{v.XSD}integer> {graph}' for name in _INTEGERS),
        f"{thing} <{v.IN_CELL}> <{v.CELL}1_1> {graph}",
        *(f'{thing} <{name}> "0.1"^^{v.XSD_DOUBLE} {graph}' for name in _DOUBLES),
        f'{thing} <{v.CONFIDENCE}> "0.1"^^{v.XSD_DOUBLE} {graph}',
        f'{thing} <{v.EXISTENCE}> "0.1"^^{v.XSD_DOUBLE} {graph}',
    ]
    return "".join(lines).encode()


def lines_of(quads: Iterable[Quad]) -> list[bytes]:
    """A line of N-Quads for each quad."""
    return (serialize(quads, format=RdfFormat.N_QUADS) or b"").splitlines()


def quads_of(lines: Iterable[bytes]) -> list[Quad]:
    """The quads of lines; blank nodes keep their labels. Raises HistoryError for other lines."""
    try:
        return [*parse(b"\n".join(lines), format=RdfFormat.N_QUADS, lenient=True)]
    except SyntaxError as error:
        raise HistoryError(f"the history is damaged ({error}); {_REMEDY}") from error


def subject_of(line: bytes) -> bytes:
    """The subject of a line, a term as in N-Quads."""
    return line.partition(b" ")[0]


def net(changes: Sequence[ChangeLines]) -> ChangeLines:
    """The net change of consecutive change sets."""
    all_removed: set[bytes] = set()
    all_added: set[bytes] = set()
    for removed, added in changes:
        for line in removed:
            all_added.remove(line) if line in all_added else all_removed.add(line)
        for line in added:
            all_removed.remove(line) if line in all_removed else all_added.add(line)
    return ChangeLines(sorted(all_removed), sorted(all_added))


def _packed(lines: Iterable[bytes]) -> bytes:
    packed, last = [], b""
    for line in sorted(lines):
        subject, _, rest = line.partition(b" ")
        packed.append(b" " + rest if subject == last else line)
        last = subject
    return b"\n".join(packed)


def _unpacked(block: bytes) -> list[bytes]:
    lines, subject = [], b""
    for line in block.splitlines():
        if line.startswith(b" "):
            lines.append(subject + line)
        else:
            lines.append(line)
            subject = subject_of(line)
    return lines


def _about(block: bytes, subject: bytes) -> list[bytes]:
    # a block is sorted, so the lines of a subject are consecutive
    start = (b"\n" + block).find(b"\n" + subject + b" ")
    if start < 0:
        return []
    first, *rest = block[start:].splitlines()
    return [first, *(subject + line for line in takewhile(lambda x: x[0] == _SPACE, rest))]


PAGE = 64  # transactions read at a time

_TOUCHED = "sequence IN (SELECT sequence FROM touched JOIN subject ON id = subject WHERE text = ?)"


@dataclass(frozen=True, slots=True)
class Commit:
    """A transaction of the log without its change set."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    cause: Cause


class LogReader:
    """The reading part of an open log; safe to use from several threads.

    `floor` and `last` are the numbers of the first and the last transaction in the log.
    """

    def __init__(self, connection: sqlite3.Connection, base: str, file: Path | None) -> None:
        self.lock = threading.RLock()
        self.file = file
        self.base = base
        self.db = connection
        self.codec = LineCodec(b"")
        self.floor = self.last = 0
        self.floor_time = self.last_time = 0.0

    @property
    def begun(self) -> bool:
        """Whether the log has a floor."""
        return self._meta("floor") is not None

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
            f"WHERE sequence > ? AND sequence <= ? ORDER BY sequence LIMIT {PAGE}"
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
        found = []
        for (data,) in rows:
            check_time()
            found.append(self.codec.change(data))
        return found

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
            check_time()
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

    def refresh(self, until: int = sys.maxsize) -> None:
        """Reload the numbers of the first and the last transaction, up to number `until`."""
        with self.lock:
            self.floor = self._meta("floor") or 0
            self.floor_time = self._meta("floor time") or 0.0
            select = "SELECT sequence, time FROM commits WHERE sequence > ? AND sequence <= ?"
            row = self.db.execute(
                f"{select} ORDER BY 1 DESC LIMIT 1", (self.floor, until)
            ).fetchone()
            self.last, self.last_time = row or (self.floor, self.floor_time)

    def _meta(self, name: str) -> Any:
        with self.lock:
            select = "SELECT value FROM meta WHERE name = ?"
            row = self.db.execute(select, (name,)).fetchone()
        return row[0] if row else None
