"""Compaction of the log: the past before a moment dropped, and the file packed."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.term_gc import Pruning, prune

AT_ONCE: Final = 4  # transactions dropped while a writer has to wait
TRIM_WITHIN: Final = 0.5  # [s] of each flush
WORTH_PRUNING: Final = 1000  # subjects forgotten, until their terms are searched for
CHECKPOINT_TRIES: Final = 250
CHECKPOINT_PAUSE: Final = 0.02  # [s]
SLACK: Final = 0.1  # of what is kept, until it is worth dropping


@dataclass(frozen=True, slots=True)
class Compaction:
    """What compacting a log did."""

    floor: int  # sequence number the past now begins at
    dropped: int  # transactions
    bytes_before: int
    bytes_after: int


def compact(log: HistoryLog, keep: float | None = None) -> Compaction:
    """Drop what lies more than `keep` seconds back (None: nothing), and pack the file.

    The state at that moment is kept, so every moment since can still be queried. A log that is
    killed midway remains valid; the rest is dropped the next time.
    """
    before, dropped = _size(log.file), 0
    if keep is not None:
        _raise_floor(log, keep)
        while some := _drop_some(log)[0]:
            dropped += some
    prune(log)
    with log.lock:
        log.db.execute("VACUUM")
        _truncate_wal(log)
    return Compaction(log.floor, dropped, before, _size(log.file))


def retain(log: HistoryLog, keep: float) -> None:
    """From now on drop what lies more than `keep` seconds back, a little at each flush.

    The file is not packed, but what is freed is written anew: it stops growing.
    """
    log.on_flush = partial(_trim, log, keep, _Leavings())


class _Leavings:
    """Subjects that were forgotten since their terms were last searched for, and that search."""

    def __init__(self) -> None:
        self.subjects = 0
        self.pruning: Pruning | None = None
        self.guard = threading.Lock()  # the store's own thread flushes, and callers of flush


def _trim(log: HistoryLog, keep: float, left: _Leavings) -> None:
    with left.guard:
        _trim_alone(log, keep, left)


def _trim_alone(log: HistoryLog, keep: float, left: _Leavings) -> None:
    if time.time() - log.floor_time > keep * (1 + SLACK):
        _raise_floor(log, keep)
    until = time.monotonic() + TRIM_WITHIN
    while (some := _drop_some(log))[0]:
        left.subjects += some[1]
        if time.monotonic() >= until:
            break
        time.sleep(0)  # a writer that waits for the log has priority
    if left.pruning is None and left.subjects >= WORTH_PRUNING:
        left.subjects, left.pruning = 0, Pruning(log)
    while left.pruning is not None:
        if left.pruning.step() is None:
            left.pruning = None
        if time.monotonic() >= until:
            return
        time.sleep(0)


def _raise_floor(log: HistoryLog, keep: float) -> None:
    """Have the past begin `keep` seconds back: nothing older is returned, though still stored."""
    with log.lock:
        edge = log.sequence_at(time.time() - keep)
        commit = log.commit(edge)
        if edge > log.floor and commit is not None:
            with log.transaction():
                log.set_floor(edge, commit.time)
            log.refresh()


def _drop_some(log: HistoryLog) -> tuple[int, int]:
    """Drop a few of the oldest transactions up to the floor.

    How many, 0 where none are left, and how many subjects are forgotten with them.
    """
    with log.lock:
        select = "SELECT sequence FROM commits WHERE sequence <= ? ORDER BY sequence LIMIT ?"
        oldest = [row[0] for row in log.db.execute(select, (log.floor, AT_ONCE))]
        if not oldest:
            return 0, 0
        nodes = log.touched(oldest[0] - 1, oldest[-1])
        with log.transaction():
            emptied = [_drop_before(log, node, log.floor) for node in nodes]
            log.db.execute("DELETE FROM commits WHERE sequence <= ?", (oldest[-1],))
        if any(emptied):
            log.forget()
        return len(oldest), sum(emptied)


def _drop_before(log: HistoryLog, node: int, edge: int) -> bool:
    """Fold a node's past up to `edge` into one state; whether nothing is left of the node."""
    some = "SELECT 1 FROM change WHERE node = ? AND sequence <= ? LIMIT 1"
    if log.db.execute(some, (node, edge)).fetchone() is None:
        return False
    facts = log.facts(node, edge)
    for table in ("change", "state"):
        log.db.execute(f"DELETE FROM {table} WHERE node = ? AND sequence <= ?", (node, edge))
    if facts and log.terms.pair(node)[0] not in BACKGROUND:
        log.put_state(node, edge, facts)
        return False
    later = "SELECT 1 FROM change WHERE node = ? LIMIT 1"
    if log.db.execute(later, (node,)).fetchone() is not None:
        return False
    log.db.execute("DELETE FROM node WHERE id = ?", (node,))
    return True


def _truncate_wal(log: HistoryLog) -> None:
    # SQLite does not wait for another checkpoint, such as that of a flush beside us
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
