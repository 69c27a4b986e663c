"""The log made small: the past before a moment dropped, and the file packed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from kg.history.log import BACKGROUND, Log


@dataclass(frozen=True, slots=True)
class Compaction:
    """What compacting a log did."""

    floor: int  # sequence number the past now begins at
    dropped: int  # transactions
    bytes_before: int
    bytes_after: int


def compact(log: Log, keep: float | None = None) -> Compaction:
    """Drop what lies more than `keep` seconds back (None: nothing), and pack the file.

    What the map said at the edge is kept, so every moment since can still be asked for. Whole or
    not at all, also when killed midway.
    """
    before, dropped = _size(log.file), 0
    if keep is not None:
        edge = log.sequence_at(time.time() - keep)
        if edge > log.floor:
            dropped = _drop(log, edge)
    with log.lock:
        log.db.execute("VACUUM")
        log.db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return Compaction(log.floor, dropped, before, _size(log.file))


def _drop(log: Log, edge: int) -> int:
    commit = log.commit(edge)
    with log.transaction():
        for node in log.nodes():
            _drop_before(log, node, edge)
        select = "DELETE FROM commits WHERE sequence <= ?"
        dropped = log.db.execute(select, (edge,)).rowcount
        unused = (
            "NOT EXISTS (SELECT 1 FROM change WHERE change.node = {0}) "
            "AND NOT EXISTS (SELECT 1 FROM state WHERE state.node = {0})"
        )
        log.db.execute("DELETE FROM member WHERE " + unused.format("member.node"))
        log.db.execute("DELETE FROM node WHERE " + unused.format("node.id"))
        log.set_floor(edge, commit.time if commit else log.floor_time)
    log.refresh()
    return int(dropped)


def _drop_before(log: Log, node: int, edge: int) -> None:
    facts = log.facts(node, edge)
    for table in ("change", "state"):
        log.db.execute(f"DELETE FROM {table} WHERE node = ? AND sequence <= ?", (node, edge))
    if facts and log.terms.pair(node)[0] not in BACKGROUND:
        log.put_state(node, edge, facts)


def _size(file: Path | None) -> int:
    if file is None:
        return 0
    parts = (file, file.with_name(file.name + "-wal"))
    return sum(part.stat().st_size for part in parts if part.exists())
