"""Syntax errors of the engine's SPARQL parser as one line of text."""

from __future__ import annotations

from typing import Final

ALTERNATIVES: Final = 6  # named where a query does not parse


def located(message: str, shift: int = 0) -> str:
    """The parser's message with line and column; `shift` columns of line 1 were put in front."""
    place, _, reason = message.removeprefix("error at ").partition(": ")
    line, colon, column = place.partition(":")
    if not (colon and line.isdigit() and column.isdigit()):
        return " ".join(message.split())
    at = max(int(column) - (shift if line == "1" else 0), 1)
    return f"does not parse at line {line}, column {at}: {' '.join(_shortened(reason).split())}"


def _shortened(reason: str) -> str:
    """The engine lists every alternative; the first few suffice."""
    options = reason.removeprefix("expected one of ").split(", ")
    if len(options) <= ALTERNATIVES:
        return reason
    return f"expected {', '.join(options[:ALTERNATIVES])}, ..."
