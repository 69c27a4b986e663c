"""Log and store brought together when a map is opened.

The log is written first, so after a crash it may hold transactions the store lacks: they are
applied. The store may also be ahead, where it was written without the log or a power cut took the
log's tail: the difference goes into the log as one transaction. A store older than the floor (an
old copy put back) is brought to where the log ends.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.commits import Cause, ChangeSet
from kg.history.log import BACKGROUND, Log
from kg.store import MapStore

FILE = "history.sqlite"
_SEQUENCE = NamedNode(v.SEQUENCE)
_REPLAYED = Cause("recovery", note="the store was older than its history")
_CAUGHT_UP = Cause("recovery", note="the map was changed without its history")


def attach(store: MapStore, folder: Path | None, base: str, *, power_safe: bool = False) -> Log:
    """Open the log of a store that is open for writing, and have it record from now on.

    Raises HistoryError where what lies there is no log of this map.
    """
    file = folder / FILE if folder else None
    log = Log.open(file, base, power_safe=power_safe)
    if not log.begun:
        log.begin(store.sequence, time.time(), filter(_is_recorded, store.engine))
    elif log.last > store.sequence:
        _replay(store, log)
    elif log.last < store.sequence:
        log.append(_difference(store, log, store.sequence, _CAUGHT_UP))
    store.journal = log
    return log


@contextmanager
def one_reader_at_a_time(folder: Path) -> Iterator[None]:
    """Within, no other reader is between looking at the log and catching up.

    Two that came at once after a crash would keep each other from the lock it takes, and both stay
    behind. The lock is on the folder itself, so that it needs no file and no right to write.
    """
    with ExitStack() as held:
        with suppress(OSError):  # what is wrong with the folder, opening it will say
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            held.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def look_into(store: MapStore, folder: Path, base: str) -> Log | None:
    """The log of a store that is open for reading, for reading; None where it keeps none."""
    file = folder / FILE
    if not file.is_file():
        return None
    log = Log.open(file, base, read_only=True)
    if not log.begun:
        log.close()
        return None
    return log


def without_past(store: MapStore, base: str) -> Log:
    """A log in memory that begins with what the store says now."""
    log = Log.open(None, base)
    log.begin(store.sequence, time.time(), filter(_is_recorded, store.engine))
    return log


def _replay(store: MapStore, log: Log) -> None:
    if store.sequence < log.floor:
        store.replay(_difference(store, log, log.last, _REPLAYED).reversed())
        return
    for change in log.changes(store.sequence):
        store.replay(change)


def _difference(store: MapStore, log: Log, sequence: int, cause: Cause) -> ChangeSet:
    """What leads from the log's last state to the store's, but for the background graphs."""
    recorded = {
        quad for node in log.nodes() for quad in log.terms.quads(node, log.facts(node, log.last))
    }
    recorded = {quad for quad in recorded if quad.graph_name not in BACKGROUND}
    stored = {quad for quad in store.engine if _is_recorded(quad)}
    added, removed = tuple(stored - recorded), tuple(recorded - stored)
    return ChangeSet(sequence, time.time(), cause, added, removed)


def _is_recorded(quad: Quad) -> bool:
    return quad.graph_name not in BACKGROUND and quad.predicate != _SEQUENCE
