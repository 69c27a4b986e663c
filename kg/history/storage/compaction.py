"""Compaction of the log: drops the past before a moment and packs the file."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from kg.history.storage.log import HistoryLog

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
