"""Recovery: brings log and store to the same state at the opening of a map.

The log is written first, so after a crash it may hold transactions that the store lacks; they are
applied. The store is ahead if it was written without the log, or if a power cut took the end of the
log; the difference is logged as one transaction. A store older than the floor (a restored old copy)
gets the difference to the last state of the log.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pyoxigraph import DefaultGraph, NamedNode, Quad, Store

from kg.history.storage.change_lines import quads_of
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.model import vocabulary as v
from kg.model.transactions import Cause, ChangeSet
from kg.rdf.datetimes import transaction_time
from kg.store.transactional import TransactionalStore

FILE = "history.sqlite"
_SEQUENCE = NamedNode(v.SEQUENCE)
_REPLAYED = Cause("recovery", note="the store was older than its history")
_CAUGHT_UP = Cause("recovery", note="the map was changed without its history")


def attach(
    store: TransactionalStore, folder: Path | None, base: str, *, power_safe: bool = False
) -> HistoryLog:
    """Open the log of a store that is open for writing, and make it the store's journal.

    Raises HistoryError if the file is no log of this map.
    """
    file = folder / FILE if folder else None
    log = HistoryLog.open(file, base, power_safe=power_safe)
    if not log.begun:
        log.begin(store.sequence, transaction_time(), _recorded(store.native))
    elif log.last > store.sequence:
        _replay(store, log)
    elif log.last < store.sequence:
        log.append(_difference(store, log, store.sequence, _CAUGHT_UP))
    store.journal = log
    return log


@contextmanager
def one_reader_at_a_time(folder: Path) -> Iterator[None]:
    """Lock out other readers during the recovery of a map in `folder`.

    After a crash, a reader that finds the store behind its log opens the map for writing. Two such
    readers would block each other's lock. This lock is on the folder itself, which needs neither a
    file nor write permission.
    """
    with ExitStack() as stack:
        with suppress(OSError):  # opening the map reports the fault of the folder
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def open_history_read_only(store: TransactionalStore, folder: Path, base: str) -> HistoryLog | None:
    """The read-only log of a read-only store; None if the map has no history."""
    file = folder / FILE
    if not file.is_file():
        return None
    log = HistoryLog.open(file, base, read_only=True)
    if not log.begun:
        log.close()
        return None
    return log


def without_past(store: TransactionalStore, base: str) -> HistoryLog:
    """A log in memory that begins at the present state of the store."""
    log = HistoryLog.open(None, base)
    log.begin(store.sequence, transaction_time(), _recorded(store.native))
    return log


def _replay(store: TransactionalStore, log: HistoryLog) -> None:
    if store.sequence < log.floor:
        store.replay(_difference(store, log, log.last, _REPLAYED).reversed())
        return
    for change in log.changes(store.sequence):
        store.replay(change)


def _difference(
    store: TransactionalStore, log: HistoryLog, sequence: int, cause: Cause
) -> ChangeSet:
    """The change from the log's last state to the store's state, without background graphs."""
    recorded = {*quads_of(log.facts(log.last))}
    stored = {*_recorded(store.native)}
    added, removed = tuple(stored - recorded), tuple(recorded - stored)
    return ChangeSet(sequence, transaction_time(), cause, added, removed)


def _recorded(engine: Store) -> Iterator[Quad]:
    """The quads of a store, graph by graph, without background graphs and transaction number."""
    for graph in (*engine.named_graphs(), DefaultGraph()):
        if graph not in BACKGROUND:
            quads = engine.quads_for_pattern(None, None, None, graph)
            yield from (quad for quad in quads if quad.predicate != _SEQUENCE)
