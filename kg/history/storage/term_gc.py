"""Garbage collection of terms: unused ones are found and dropped while the log is in use.

What refers to a term is coded in the rows, so all rows are read once, a few at a time; rows that
are written meanwhile are reported by the log (`HistoryLog.watchers`) and read before a term is
dropped. A process that dies midway has dropped none that was in use; the next search begins anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from kg.history.storage.log import HistoryLog
from kg.history.storage.row_codec import INTERNED, decode_delta
from kg.history.storage.term_dictionary import KEPT

_ROWS_AT_ONCE: Final = 500


class Pruning:
    """One search through a log; `step` until it returns None, or let `prune` do so.

    `written` has node and number of the rows written since it began or last read them.
    """

    def __init__(self, log: HistoryLog) -> None:
        self._log = log
        self.written: set[tuple[int, int]] = set()
        with log.lock:
            log.watchers.add(self)
            (last,) = log.db.execute("SELECT max(id) FROM term").fetchone()
        self._last = int(last or 0)  # ignores terms that are created from now on
        self._used = bytearray(self._last + 1)
        self._steps = self._work()

    def step(self) -> int | None:
        """Go on for a moment; how many terms it dropped, None where the search is over."""
        return next(self._steps, None)

    def _work(self) -> Iterator[int]:
        for number in range(min(KEPT, self._last) + 1):
            self._used[number] = 1
        yield from self._read("SELECT id, 0, subject, graph FROM node", "id", None)
        # states come last: what a compaction meanwhile folds of changes, it folds into a state
        yield from self._read("SELECT node, sequence, data FROM change", "node", "sequence")
        yield from self._read("SELECT node, sequence, data FROM state", "node", "sequence")
        yield from self._drop()
        with self._log.lock:
            self._log.watchers.discard(self)

    def _read(self, select: str, first: str, second: str | None) -> Iterator[int]:
        """Note the terms in all rows of a table, in the order of its key."""
        key = first if second is None else f"{first}, {second}"
        bound = f"{key} > ?" if second is None else f"({key}) > (?, ?)"
        page = f"{select} WHERE {bound} ORDER BY {key} LIMIT {_ROWS_AT_ONCE}"
        at: tuple[int, ...] = (-1,) if second is None else (-1, -1)
        while True:
            with self._log.lock:
                rows = self._log.db.execute(page, at).fetchall()
            if not rows:
                return
            for _, _, *held in rows:
                self._note(held)
            at = rows[-1][: len(at)]
            yield 0

    def _note(self, held: list[int | bytes]) -> None:
        for one in held:
            if isinstance(one, int):
                self._use(one)
                continue
            delta = decode_delta(one)
            for coded in (*delta.removed, *delta.added):
                self._use(coded.predicate)
                if coded.kind == INTERNED:
                    self._use(int(coded.value))

    def _use(self, number: int) -> None:
        if number <= self._last:
            self._used[number] = 1

    def _drop(self) -> Iterator[int]:
        db, at = self._log.db, 0
        select = f"SELECT id FROM term WHERE id > ? AND id <= ? ORDER BY id LIMIT {_ROWS_AT_ONCE}"
        while True:
            with self._log.lock:
                rows = db.execute(select, (at, self._last)).fetchall()
                if not rows:
                    return
                at = rows[-1][0]
                self._note_written()
                unused = [row for row in rows if not self._used[row[0]]]
                if unused:
                    with self._log.transaction():
                        db.executemany("DELETE FROM term WHERE id = ?", unused)
                    self._log.terms.forget()
            yield len(unused)

    def _note_written(self) -> None:
        """Note the terms in the rows that were written since the search began."""
        db = self._log.db
        for node, sequence in self.written:
            pair = db.execute("SELECT subject, graph FROM node WHERE id = ?", (node,)).fetchone()
            self._note([*(pair or ())])
            for table in ("change", "state"):
                select = f"SELECT data FROM {table} WHERE node = ? AND sequence = ?"
                for row in db.execute(select, (node, sequence)):
                    self._note([*row])
        self.written.clear()


def prune(log: HistoryLog) -> int:
    """Drop every term that nothing refers to; how many."""
    pruning, dropped = Pruning(log), 0
    while (some := pruning.step()) is not None:
        dropped += some
    return dropped
