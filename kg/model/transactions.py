"""Transactions: the quads added and removed, the time, and the cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pyoxigraph import Quad

Kind = Literal[
    "frame",
    "update",
    "assert",
    "retract",
    "import",
    "ontology",
    "recovery",
    "search",
    "restore",
    "rooms",
]


@dataclass(frozen=True, slots=True)
class Cause:
    """Reason for a transaction: its kind, its author, and a note."""

    kind: Kind
    by: str | None = None  # name of a person or program; None: the mapper
    note: str = ""  # e.g. "redkitchen/frame-000056", or the text of an update


@dataclass(frozen=True, slots=True)
class ChangeSet:
    """One transaction: the quads it added to the graph, and those it removed."""

    sequence: int  # 1, 2, 3, ... without gaps
    time: float  # [s] since 1970-01-01 UTC, when it was applied
    cause: Cause
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]
    notes: tuple[str, ...] = ()  # what its author should know of it; not kept

    def __len__(self) -> int:
        return len(self.added) + len(self.removed)

    def reversed(self) -> ChangeSet:
        """The inverse change set, under the same number."""
        return ChangeSet(self.sequence, self.time, self.cause, self.removed, self.added)


#: Called with each stored change set, in order, on the committing thread.
Listener = Callable[[ChangeSet], None]
