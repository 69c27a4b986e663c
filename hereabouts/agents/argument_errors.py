"""Errors of arguments in one plain line: the argument, the limit, and a short form of the value."""

from __future__ import annotations

from typing import Final

from pydantic import ValidationError
from pydantic_core import ErrorDetails

_SHOWN: Final = 40  # characters of a value

#: kind of error of pydantic -> the limit in words
_WORDS: Final = {
    "string_too_long": "should have at most {max_length:,} characters",
    "string_too_short": "should have at least {min_length:,} character",
    "too_long": "should have at most {max_length:,} entries",
    "too_short": "should have {min_length:,} or more entries",
    "less_than_equal": "should be less than or equal to {le:,.12g}",
    "less_than": "should be less than {lt:,.12g}",
    "greater_than_equal": "should be greater than or equal to {ge:,.12g}",
    "greater_than": "should be greater than {gt:,.12g}",
    "finite_number": "should be a finite number",
    "string_type": "should be a text",
    "list_type": "should be a list",
    "dict_type": "should be an object",
    "bool_type": "should be true or false",
    "bool_parsing": "should be true or false",
    "int_type": "should be a whole number",
    "int_parsing": "should be a whole number",
    "int_parsing_size": "should be a whole number",
    "int_from_float": "should be a whole number",
    "float_type": "should be a number",
    "float_parsing": "should be a number",
    "literal_error": "should be {expected}",
    "missing": "is missing",
}


def argument_error(error: ValidationError) -> str:
    """``what should have at most 100 characters, got 5,000``: one wrong argument, in one line."""
    details = error.errors(include_url=False)
    first = details[0]
    name = _name(first["loc"])
    same = [one for one in details if one["loc"][:1] == first["loc"][:1]]  # an error for each type
    words = list(dict.fromkeys(map(_limit, same)))
    limit = " or ".join([words[0], *(word.removeprefix("should be ") for word in words[1:])])
    return f"{name} {limit}" if first["type"] == "missing" else f"{name} {limit}, got {_got(first)}"


def _name(path: tuple[int | str, ...]) -> str:
    """``what``, or ``entry 2 of what``; names of types, which follow, are left out."""
    entry = path[1] if len(path) > 1 else None
    argument = str(path[0]) if path else "the argument"
    return f"entry {entry + 1} of {argument}" if isinstance(entry, int) else argument


def _limit(one: ErrorDetails) -> str:
    kind = one["type"]
    if kind == "too_long" and isinstance(one["input"], str):
        kind = "string_too_long"
    return _WORDS.get(kind, "should have another form").format(**one.get("ctx", {}))


def _got(one: ErrorDetails) -> str:
    """A short value as it is; of a long one its length."""
    value, kind = one["input"], one["type"]
    if kind.endswith("too_long"):
        return f"{len(value):,}"
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]} ..."
