"""Syntax errors of the engine's SPARQL parser as one line of text."""

from __future__ import annotations

from typing import Final

MAX_ALTERNATIVES: Final = 6  # expected tokens in a message; the engine lists all


def located(message: str, shift: int = 0) -> str:
    """The parser's message with line and column; line 1 has `shift` columns of prologue."""
    place, _, reason = message.removeprefix("error at ").partition(": ")
    line, colon, column = place.partition(":")
    if not (colon and line.isdigit() and column.isdigit()):
        return " ".join(message.split())
    at = max(int(column) - (shift if line == "1" else 0), 1)
    options = reason.removeprefix("expected one of ").split(", ")
    if len(options) > MAX_ALTERNATIVES:
        reason = f"expected {', '.join(options[:MAX_ALTERNATIVES])}, ..."
    return f"does not parse at line {line}, column {at}: {' '.join(reason.split())}"
