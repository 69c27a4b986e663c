"""Recovery: brings log and store to the same state at the opening of a map.

The log is written first, so after a crash it may hold transactions that the store lacks; they are
applied; where one cannot be read, it and later ones are set aside. The store is ahead if it was
written without the log, or if a power cut took the end of the log; the difference is logged as one
transaction. A store older than the floor (a restored old copy) gets the difference to the last
state of the log.
"""

from __future__ import annotations

import logging
import os
import sqlite3
from collections.abc import Iterator
from itertools import count
from pathlib import Path

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
