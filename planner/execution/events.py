"""Events of a search: one each time something is decided or happens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened, for people and for programs."""

    kind: str  # begin, plan, arrived, look, seen, found, surprise, note, end
    text: str  # for people, one line
    data: Mapping[str, Any] = field(default_factory=dict)  # plain values

    def to_json(self) -> dict[str, Any]:
        """Plain values, for a line of JSON."""
        return {"event": self.kind, **self.data, "text": self.text}


EventSink = Callable[[Event], None]
