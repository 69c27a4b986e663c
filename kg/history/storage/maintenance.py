"""Maintenance of the log: recovery at the opening of a map, and compaction.

Recovery brings log and store to the same state. The log is written first, so after a crash it may
hold transactions that the store lacks; they are applied; where one cannot be read, it and later
ones are set aside. The store is ahead if it was written without the log, or if a power cut took the
end of the log; the difference is logged as one transaction. A store older than the floor (a
restored old copy) gets the difference to the last state of the log.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Final

from pyoxigraph import DefaultGraph, NamedNode, Quad, Store

from kg.history.storage.log import WITHOUT_KEY_FRAMES, HistoryLog
from kg.history.storage.log_reader import quads_of
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.literals import transaction_time
from kg.store.transactional import TransactionalStore

FILE = "history.sqlite"
_SEQUENCE = NamedNode(v.SEQUENCE)
_log = logging.getLogger(__name__)
_REPLAYED = Cause("recovery", note="the store was older than its history")
_CAUGHT_UP = Cause("recovery", note="the map was changed without its history")


def attach(
    store: TransactionalStore,
    folder: Path | None,
    base: str,
    *,
    power_safe: bool = False,
    sets_aside: bool = True,
) -> HistoryLog:
    """Open the log of a store that is open for writing, and make it the store's journal.

    `sets_aside` keeps a copy of a log with transactions that cannot be read. Raises HistoryError if
    the file is no log of this map.
    """
    file = folder / FILE if folder else None
    log = HistoryLog.open(file, base, power_safe=power_safe)
    if not log.begun:
        log.begin(store.sequence, transaction_time(), _recorded(store.native))
    elif log.last > store.sequence:
        _replay(store, log, sets_aside)
    elif log.last < store.sequence:
        log.append(_difference(store, log, store.sequence, _CAUGHT_UP))
    store.journal = log
    return log


def open_history_read_only(store: TransactionalStore, folder: Path, base: str) -> HistoryLog | None:
    """The read-only log of a read-only store; None if the map has no history."""
    file = folder / FILE
    if not file.is_file():
        return None
    log = HistoryLog.open(file, base, read_only=True, live=store.live)
    if not log.begun:
        log.close()
        return None
    return log


def without_past(store: TransactionalStore, base: str) -> HistoryLog:
    """A log in memory that begins at the present state of the store."""
    log = HistoryLog.open(None, base)
    log.begin(store.sequence, transaction_time(), _recorded(store.native))
    return log


def _replay(store: TransactionalStore, log: HistoryLog, sets_aside: bool) -> None:
    if store.sequence < log.floor:
        store.replay(_difference(store, log, log.last, _REPLAYED).reversed())
        return
    changes = log.changes(store.sequence)
    while True:
        try:
            change = next(changes, None)
        except HistoryError as error:
            _drop_unreadable(log, store.sequence + 1, error, sets_aside)
            return
        if change is None:
            return
        store.replay(change)


def _drop_unreadable(log: HistoryLog, first: int, error: HistoryError, sets_aside: bool) -> None:
    """Remove the transactions from `first` on, which cannot be read, from the log.

    With `sets_aside` a copy of the whole file stays beside it. Raises GraphError if it cannot be
    written.
    """
    if log.file is None:
        raise error
    names = (f"history-set-aside-{first}-{number}.sqlite" for number in count(1))
    copy = next(path for path in map(log.file.with_name, names) if not os.path.lexists(path))
    try:
        if sets_aside:
            log.db.execute("VACUUM INTO ?", (str(copy),))
        with log.transaction():
            for table in ("commits", "change", "background", "touched"):
                log.db.execute(f"DELETE FROM {table} WHERE sequence >= ?", (first,))
            unbegun = "DELETE FROM state WHERE sequence >= ? AND sequence > ?"
            log.db.execute(unbegun, (first, log.floor))
            unused = "NOT EXISTS (SELECT 1 FROM touched WHERE touched.subject = id)"
            log.db.execute(f"DELETE FROM subject WHERE {unused}")
        log.refresh()
    except sqlite3.Error as failure:
        raise GraphError(f"cannot set a damaged history aside as {copy}: {failure}") from error
    _log.warning(
        "transactions from #%d on cannot be replayed (%s); the map is as before them, "
        "and %s keeps them",
        *(first, str(error).partition(";")[0], copy.name if sets_aside else "its history"),
    )


def _difference(
    store: TransactionalStore, log: HistoryLog, sequence: int, cause: Cause
) -> ChangeSet:
    """The change from the log's last state to the store's state, without background graphs."""
    recorded = {*quads_of(log.facts(log.last))}
    stored = {*_recorded(store.native)}
    added, removed = tuple(stored - recorded), tuple(recorded - stored)
    return ChangeSet(sequence, transaction_time(), cause, added, removed)


def _recorded(engine: Store) -> Iterator[Quad]:
    """The quads that a log records, graph by graph, without those of `WITHOUT_KEY_FRAMES`."""
    for graph in (*engine.named_graphs(), DefaultGraph()):
        if graph not in WITHOUT_KEY_FRAMES:
            quads = engine.quads_for_pattern(None, None, None, graph)
            yield from (quad for quad in quads if quad.predicate != _SEQUENCE)


MAX_DROPPED: Final = 16  # transactions dropped in one step, while a writer waits
TRIM_WITHIN: Final = 0.5  # [s] of each flush
CHECKPOINT_TRIES: Final = 250
CHECKPOINT_PAUSE: Final = 0.02  # [s]
SLACK: Final = 0.1  # excess over the kept time, as a share of it, before a drop


@dataclass(frozen=True, slots=True)
class Compaction:
    """The result of a compaction."""

    floor: int  # number of the first kept transaction
    dropped: int  # number of transactions
    bytes_before: int
    bytes_after: int


def compact(log: HistoryLog, keep: float | None = None) -> Compaction:
    """Drop transactions older than `keep` seconds (None: none) and pack the file.

    The state at that moment is kept, so every later moment can still be queried. After an
    interruption the log is valid, and the next compaction drops the rest.
    """
    before, dropped = _size(log.file), 0
    with log.upkeep:
        if keep is not None:
            _raise_floor(log, keep)
            while some := _drop_some(log):
                dropped += some
        with log.lock:
            log.db.execute("VACUUM")
            _truncate_wal(log)
    return Compaction(log.floor, dropped, before, _size(log.file))


def retain(log: HistoryLog, keep: float) -> None:
    """From now on drop transactions older than `keep` seconds, a few at each flush.

    The file is not packed, but stops growing, since SQLite reuses freed pages.
    """
    log.on_flush = partial(_trim, log, keep)


def _trim(log: HistoryLog, keep: float) -> None:
    with log.upkeep:
        if time.time() - log.floor_time > keep * (1 + SLACK):
            _raise_floor(log, keep)
        until = time.monotonic() + TRIM_WITHIN
        while _drop_some(log) and time.monotonic() < until:
            time.sleep(0)  # lets a waiting writer have the log


def _raise_floor(log: HistoryLog, keep: float) -> None:
    edge = log.commit(log.sequence_at(time.time() - keep))
    if edge is not None and edge.sequence > log.floor:
        log.raise_floor(edge)


def _drop_some(log: HistoryLog) -> int:
    """Drop a few of the oldest transactions up to the floor; returns their number."""
    with log.lock:
        select = "SELECT sequence FROM commits WHERE sequence <= ? ORDER BY sequence LIMIT ?"
        oldest = [row[0] for row in log.db.execute(select, (log.floor, MAX_DROPPED))]
        if oldest:
            with log.transaction():
                log.delete(oldest[0], oldest[-1])
        return len(oldest)


def _truncate_wal(log: HistoryLog) -> None:
    # SQLite does not wait for a concurrent checkpoint, such as that of a flush
    for _ in range(CHECKPOINT_TRIES):
        busy = log.db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
        if not busy:
            return
        time.sleep(CHECKPOINT_PAUSE)


def _size(file: Path | None) -> int:
    if file is None:
        return 0
    parts = (file, file.with_name(file.name + "-wal"))
    return sum(part.stat().st_size for part in parts if part.exists())
