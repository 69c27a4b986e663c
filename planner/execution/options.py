"""Options, events and outcome of a search with a robot."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from kg.model.records import SearchState
from kg.model.shares import percent
from mapping.labels.label_resolver import LabelTable
from planner.settings import BELIEF


@dataclass(frozen=True, slots=True)
class SearchOutcome:
    """Outcome of one run of a search."""

    search: str  # IRI
    state: SearchState
    reason: str
    found: tuple[str, ...]  # IRIs of objects
    left: float  # probability that a target still wanted is on this floor
    seconds: float  # [s] by the robot's clock, over all runs
    looks: int  # over all runs

    @property
    def line(self) -> str:
        """One line for people."""
        after = f"after {self.seconds:.0f} s and {self.looks} look{'s' * (self.looks != 1)}"
        if self.state == "found":
            return f"found {after}"
        rest = f"it is still there with {percent(self.left)}"
        return f"{self.state} {after}: {self.reason}; {rest}"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "search": self.search,
            "state": self.state,
            "reason": self.reason,
            "found": list(self.found),
            "left": round(self.left, 4),
            "seconds": round(self.seconds, 1),
            "looks": self.looks,
        }


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """Options of a search with a robot."""

    budget: float | None = None  # [s] of the robot's clock for this run
    give_up_at: float = BELIEF.stop_below  # chance that views missed a target, to give up at
    timeout: float = 30.0  # [s] that a robot may be silent
    labels: LabelTable = field(default_factory=LabelTable)  # of what the robot detects
    stopping: Callable[[], bool] = field(default=lambda: False)
    on_event: EventSink = field(default=lambda event: None)
    clock: Callable[[], float] = time.time  # of the facts written


@dataclass(frozen=True, slots=True)
class Event:
    """Event of a search, for people and for programs."""

    kind: str  # begin, plan, arrived, look, seen, found, surprise, note, end
    text: str  # for people, one line
    data: Mapping[str, Any] = field(default_factory=dict)  # plain values

    def to_json(self) -> dict[str, Any]:
        """Plain values, for a line of JSON."""
        return {"event": self.kind, **self.data, "text": self.text}


EventSink = Callable[[Event], None]
