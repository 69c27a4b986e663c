"""Validation results: one violation or warning about one node of a graph."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """Validation result: of SHACL, or of another check."""

    focus: str  # IRI of what is wrong, or a blank node's name
    message: str
    path: str = ""  # IRI of the property, where one is to blame
    value: str = ""  # what was found there
    severity: str = "violation"  # or "warning"

    def without_value(self) -> Finding:
        """The same fault, whatever the value that shows it."""
        return replace(self, value="")

    def __str__(self) -> str:
        value = f" (found {self.value})" if self.value else ""
        return f"{self.severity}: {self.focus}: {self.message}{value}"
