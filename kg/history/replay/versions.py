"""Versions of a thing: the transactions that changed the facts about it.

Ontology and common sense have no versions here: nothing is kept of how they began.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Final

from kg.history.replay.point_in_time import named
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.row_codec import Coded, decode_delta

_PAGE: Final = """
SELECT DISTINCT sequence FROM change
WHERE node IN (SELECT value FROM json_each(?)) AND sequence > ? AND sequence <= ?
ORDER BY sequence DESC LIMIT ?
"""
_ROWS: Final = """
SELECT sequence, node, data FROM change
WHERE node IN (SELECT value FROM json_each(?)) AND sequence >= ? AND sequence <= ?
ORDER BY sequence
"""
_TIMES: Final = """
SELECT sequence, time FROM commits WHERE sequence IN (SELECT value FROM json_each(?))
"""
_FIRST: Final = """
SELECT min(sequence) FROM change
WHERE node IN (SELECT value FROM json_each(?)) AND sequence > ?
"""


@dataclass(frozen=True, slots=True)
class Version:
    """The facts about a thing from one transaction on, until the next that changed them."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    empty: bool = False  # no facts: it had been removed


def version_at(log: HistoryLog, iri: str, sequence: int) -> Version | None:
    """The version right after a transaction; None where the log has none so far."""
    found = versions(log, iri, until=sequence, most=1)
    return found[0] if found else None


def first_version(log: HistoryLog, iri: str) -> Version | None:
    """The oldest version that is kept, and not empty."""
    with log.lock:
        nodes = _nodes(log, iri)
        if any(log.facts(node, log.floor) for node in nodes):
            return Version(log.floor, log.floor_time)
        (first,) = log.db.execute(_FIRST, (_json(nodes), log.floor)).fetchone()
    return None if first is None else version_at(log, iri, int(first))


def versions(
    log: HistoryLog, iri: str, *, until: int | None = None, most: int = 1000
) -> list[Version]:
    """The last versions up to the transaction `until`, the latest first; at most that many.

    Raises HistoryError for what is no absolute IRI.
    """
    until = log.last if until is None else until
    with log.lock:
        nodes = _nodes(log, iri)
        page = (_json(nodes), log.floor, until, most)
        changed = [row[0] for row in log.db.execute(_PAGE, page)]
        found = _versions_of(log, nodes, changed) if changed else []
        if len(changed) < most and any(log.facts(node, log.floor) for node in nodes):
            found.append(Version(log.floor, log.floor_time))
    return found


def _versions_of(log: HistoryLog, nodes: list[int], changed: list[int]) -> list[Version]:
    """A version for each of the transactions, which are the latest first."""
    oldest, newest = changed[-1], changed[0]
    facts: dict[int, set[Coded]] = {node: log.facts(node, oldest - 1) for node in nodes}
    rows = log.db.execute(_ROWS, (_json(nodes), oldest, newest)).fetchall()
    times = dict(log.db.execute(_TIMES, (_json(changed),)))
    found = []
    for sequence, some in groupby(rows, key=lambda row: int(row[0])):
        for _, node, data in some:
            delta = decode_delta(data)
            facts[node].difference_update(delta.removed)
            facts[node].update(delta.added)
        found.append(Version(sequence, times[sequence], not any(facts.values())))
    return found[::-1]


def _nodes(log: HistoryLog, iri: str) -> list[int]:
    nodes = log.terms.nodes_of(named(iri))
    return [node for node in nodes if log.terms.pair(node)[0] not in BACKGROUND]


def _json(nodes: list[int]) -> str:
    return f"[{', '.join(map(str, nodes))}]"
