"""Timeline of a map: spans of time with transactions, and the moments of changes in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from kg.history.storage.log import HistoryLog

MAX_MARKS: Final = 400  # of one timeline; marks that are close together are joined
MAX_SPANS: Final = 40
GAP: Final = 0.02  # share of all time with transactions that a quiet time must exceed to be cut out
MIN_GAP: Final = 60.0  # [s]


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment at which things changed."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    objects: int  # that appeared, or are gone since
    edits: int  # transactions of people


@dataclass(frozen=True, slots=True)
class Timeline:
    """Spans of time without long quiet times between transactions, and marks in them."""

    first: tuple[int, float]  # number and time [s] of the oldest moment that is kept
    last: tuple[int, float]
    spans: tuple[tuple[float, float], ...]  # [s] beginning and end
    marks: tuple[Mark, ...]


def timeline(log: HistoryLog, base: str, there: Collection[str]) -> Timeline:
    """The timeline of a log: an axis of the clock from which quiet times are cut out.

    `there` has the IRIs of the present objects; the last write of another object is its end.
    """
    with log.lock:
        times = [log.floor_time] + [
            time
            for (time,) in log.db.execute(
                "SELECT time FROM commits WHERE sequence > ? ORDER BY time", (log.floor,)
            )
        ]
        marks = _marks(log, base, there)
    ends = (log.floor, log.floor_time), (log.last, log.last_time)
    return Timeline(*ends, _spans(times), _joined(marks))


def _spans(times: list[float]) -> tuple[tuple[float, float], ...]:
    steps = sorted(later - earlier for earlier, later in pairwise(times))
    busy = sum(step for step in steps if step <= MIN_GAP)
    longest = steps[-MAX_SPANS] if len(steps) >= MAX_SPANS else 0.0
    least = max(MIN_GAP, GAP * busy, longest)
    spans = [[times[0], times[0]]]
    for time in times[1:]:
        if time - spans[-1][1] > least:
            spans.append([time, time])
        spans[-1][1] = time
    return tuple((start, end) for start, end in spans)


def _marks(log: HistoryLog, base: str, there: Collection[str]) -> list[Mark]:
    """A mark for each transaction in which an object came or went, or that a person made."""
    start = f"<{base}object/"
    rows = log.db.execute(
        "SELECT text, (SELECT min(sequence) FROM touched WHERE subject = id AND sequence > :floor),"
        " (SELECT max(sequence) FROM touched WHERE subject = id AND sequence > :floor) "
        "FROM subject WHERE text >= :start AND text < :end",
        {"floor": log.floor, "start": start, "end": f"{start}\U0010ffff"},
    )
    objects = Counter[int]()
    for text, first, last in rows:
        iri = text[1:-1]
        if "/" not in text[len(start) :] and first is not None:  # no belief or relation
            objects.update({first} if iri in there else {first, last})
    commits = log.db.execute(
        "SELECT sequence, time, by FROM commits WHERE sequence > ? ORDER BY sequence", (log.floor,)
    )
    return [
        Mark(sequence, time, objects[sequence], int(by is not None))
        for sequence, time, by in commits
        if objects[sequence] or by is not None
    ]


def _joined(marks: list[Mark]) -> tuple[Mark, ...]:
    """At most `MAX_MARKS` marks: neighbours become one, at the last of their moments."""
    size = -(-len(marks) // MAX_MARKS)
    groups = [marks[at : at + size] for at in range(0, len(marks), size or 1)]
    return tuple(
        Mark(
            group[-1].sequence,
            group[-1].time,
            sum(mark.objects for mark in group),
            sum(mark.edits for mark in group),
        )
        for group in groups
    )
