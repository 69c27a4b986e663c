"""Versions of a thing: the transactions that changed the facts about it.

Ontology and common sense have no versions here: the log does not keep how they began.
"""

from __future__ import annotations

from dataclasses import dataclass

from kg.history.replay.point_in_time import subject_line
from kg.history.storage.log import HistoryLog


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
    found = [version for version in versions(log, iri, most=-1) if not version.empty]
    return found[-1] if found else None


def versions(
    log: HistoryLog, iri: str, *, until: int | None = None, most: int = 1000
) -> list[Version]:
    """The last versions up to the transaction `until`, the latest first; at most that many.

    Raises HistoryError for what is no absolute IRI.
    """
    subject, found = subject_line(iri), list[Version]()
    with log.lock:
        changes = log.history(subject, until, most)
        facts = log.facts(changes[0][0] - 1 if changes else log.floor, subject)
        if facts and len(changes) != most:
            found.append(Version(log.floor, log.floor_time))
        for sequence, change in changes:
            commit = log.commit(sequence)
            facts.difference_update(change.removed)
            facts.update(change.added)
            if commit is not None:
                found.append(Version(sequence, commit.time, not facts))
    return found[::-1]
