"""The answer to a plain question, with the shipped query that has its facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from planner.questions.patterns import Kind


@dataclass(frozen=True, slots=True)
class PlainAnswer:
    """The answer to a plain question, and how the question was understood."""

    kind: Kind
    query: str  # shipped query that has the facts
    parameters: Mapping[str, str]  # of the query
    lines: tuple[str, ...]  # the answer in sentences
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[object, ...], ...] = field(default=())
    things: tuple[str, ...] = ()  # IRIs of what was counted, beside those of the rows

    @property
    def command(self) -> str:
        """The same facts by `hereabouts ask`; "" where no query has them."""
        if not self.query:
            return ""
        given = "".join(f" -p {name}='{value}'" for name, value in self.parameters.items())
        return f"hereabouts ask MAP {self.query}{given}"

    def to_json(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {
            "kind": self.kind,
            "query": self.query,
            "parameters": dict(self.parameters),
            "answer": list(self.lines),
        }
