"""Log and store brought together when a map is opened.

The log is written first, so after a crash it may hold transactions the store lacks: they are
applied. The store may also be ahead, where it was written without the log or a power cut took the
log's tail: the difference is logged as one transaction. A store older than the floor (an
old copy put back) is brought to where the log ends.
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
    """Open the log of a store that is open for writing, and have it record from now on.

    Raises HistoryError where what lies there is no log of this map.
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
    """Within, no other reader is between looking at the log and catching up.

    After a crash a reader that finds the store behind its log opens the map for writing. Two at
    once would keep each other from the writer's lock. The lock here is on the folder itself, so
    that it needs no file and no right to write.
    """
    with ExitStack() as held:
        with suppress(OSError):  # opening the folder reports what is wrong with it
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            held.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def open_history_read_only(store: TransactionalStore, folder: Path, base: str) -> HistoryLog | None:
    """The log of a store that is open for reading, for reading; None where it keeps none."""
    file = folder / FILE
    if not file.is_file():
        return None
    log = HistoryLog.open(file, base, read_only=True)
    if not log.begun:
        log.close()
        return None
    return log


def without_past(store: TransactionalStore, base: str) -> HistoryLog:
    """A log in memory that begins with the present state of the store."""
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
    """The change from the log's last state to the store's, without the background graphs."""
    recorded = {*quads_of(log.facts(log.last))}
    stored = {*_recorded(store.native)}
    added, removed = tuple(stored - recorded), tuple(recorded - stored)
    return ChangeSet(sequence, transaction_time(), cause, added, removed)


def _recorded(engine: Store) -> Iterator[Quad]:
    """The quads of a store that its log keeps, graph by graph: all but the background graphs."""
    for graph in (*engine.named_graphs(), DefaultGraph()):
        if graph not in BACKGROUND:
            quads = engine.quads_for_pattern(None, None, None, graph)
            yield from (quad for quad in quads if quad.predicate != _SEQUENCE)
