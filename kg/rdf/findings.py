"""Validation results: one violation or warning about one node of a graph."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """Validation result of SHACL or of another check."""

    focus: str  # IRI of the faulty node, or name of a blank node
    message: str
    path: str = ""  # IRI of the faulty property, if any
    value: str = ""  # faulty value, if any
    severity: str = "violation"  # or "warning"

    def without_value(self) -> Finding:
        """The finding without its value, to compare faults."""
        return replace(self, value="")

    def __str__(self) -> str:
        value = f" (found {self.value})" if self.value else ""
        return f"{self.severity}: {self.focus}: {self.message}{value}"
