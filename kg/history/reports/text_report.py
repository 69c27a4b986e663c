"""Text reports on the past: history of a thing, difference of two moments, explanation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from kg.history.replay.point_in_time import Difference
from kg.history.reports.comparison import Comparison
from kg.history.reports.events import HistoryEvent
from kg.history.reports.explanation import Explanation
from kg.history.timestamps import iso

#: Labels of the kinds of steps; the other labels are the kinds themselves.
_LABELS: Final = {
    **dict.fromkeys(("thing", "fact", "was"), ""),
    "observation": "evidence",
    "commit": "written",
    "change": "last change",
    "person": "by",
    "view": "views",
}


def log_text(entries: Iterable[HistoryEvent]) -> str:
    """A line for each transaction."""
    return _lines(
        f"#{entry.sequence} {iso(entry.time)} {_cause(entry)}: {entry.words}" for entry in entries
    )


def difference_text(found: Difference, base: str) -> str:
    """A line for each differing property of a thing."""
    return _lines(
        f"{sign} {subject} {what}: {_step(before, after)}"
        for sign, subject, what, before, after in found.rows(base)
    )


def comparison_text(found: Comparison) -> str:
    """A line for each change of an object, and one for floor and surface."""
    changes = (f"{one.kind} {one.iri} {one.category}: {_step(*one.sides)}" for one in found.changes)
    return _lines((*changes, found.area_words))


def reasons_text(reasons: Iterable[Explanation]) -> str:
    """A line for each step, indented by its depth."""
    return _lines(
        f"{'  ' * depth}{label_of(step)}{step.text}"
        for reason in reasons
        for depth, step in reason.walk()
    )


def label_of(step: Explanation) -> str:
    """Relation of a step to the one before it, as ``evidence: ``; empty for things and facts."""
    label = _LABELS.get(step.kind, step.kind)
    return f"{label}: " if label else ""


def _cause(entry: HistoryEvent) -> str:
    cause = entry.cause
    return " ".join(filter(None, (cause.kind, cause.note, cause.by and f"by {cause.by}")))


def _step(before: str, after: str) -> str:
    return f"{before} -> {after}" if before and after else after or before


def _lines(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
