"""Compaction of the log: the past before a moment dropped, and the file packed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from kg.history.storage.log import HistoryLog

AT_ONCE: Final = 16  # transactions dropped while a writer has to wait
TRIM_WITHIN: Final = 0.5  # [s] of each flush
CHECKPOINT_TRIES: Final = 250
CHECKPOINT_PAUSE: Final = 0.02  # [s]
SLACK: Final = 0.1  # share of the time kept that may lie beyond it, before it is dropped


@dataclass(frozen=True, slots=True)
class Compaction:
    """The result of compacting a log."""

    floor: int  # sequence number the past now begins at
    dropped: int  # transactions
    bytes_before: int
    bytes_after: int


def compact(log: HistoryLog, keep: float | None = None) -> Compaction:
    """Drop transactions more than `keep` seconds back (None: none), and pack the file.

    The state at that moment is kept, so every moment since can still be queried. A log that is
    killed midway remains valid; the rest is dropped the next time.
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
    """From now on drop transactions more than `keep` seconds back, a few at each flush.

    The file is not packed, but freed pages are written anew: it stops growing.
    """
    log.on_flush = partial(_trim, log, keep)


def _trim(log: HistoryLog, keep: float) -> None:
    with log.upkeep:
        if time.time() - log.floor_time > keep * (1 + SLACK):
            _raise_floor(log, keep)
        until = time.monotonic() + TRIM_WITHIN
        while _drop_some(log) and time.monotonic() < until:
            time.sleep(0)  # a writer that waits for the log has priority


def _raise_floor(log: HistoryLog, keep: float) -> None:
    edge = log.commit(log.sequence_at(time.time() - keep))
    if edge is not None and edge.sequence > log.floor:
        log.raise_floor(edge)


def _drop_some(log: HistoryLog) -> int:
    """Drop a few of the oldest transactions up to the floor; how many, 0 where none are left."""
    with log.lock:
        select = "SELECT sequence FROM commits WHERE sequence <= ? ORDER BY sequence LIMIT ?"
        oldest = [row[0] for row in log.db.execute(select, (log.floor, AT_ONCE))]
        if oldest:
            with log.transaction():
                log.delete(oldest[0], oldest[-1])
        return len(oldest)


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
