"""The graph of ConceptNet 4: start, end and a Python dictionary of freq, score and rel."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING, Final

from kg.conceptnet.assertion import (
    Assertion,
    Node,
    Unreadable,
    assertion_iri,
    clean,
    columns_of,
    data_of,
    license_iri,
    number_of,
    parse_relation,
)

if TYPE_CHECKING:
    from kg.conceptnet.dump import Wanted

_COLUMNS: Final = 3
_LONGEST_LITERAL: Final = 1000  # bytes; nesting that deep would be hostile
_MOST_VOTES: Final = 1e6
_RELATION: Final = re.compile(rb"'rel': u?'(\w+)'")
_LICENSE: Final = license_iri("cc:by-sa/4.0")


def looks_like(line: bytes) -> bool:
    """Whether a line has the form of an assertion of ConceptNet 4."""
    columns = line.split(b"\t")
    return len(columns) == _COLUMNS and columns[2].startswith(b"{") and b"'rel'" in columns[2]


def parse(line: bytes, language: str, wanted: Wanted) -> Assertion | None:
    """The assertion of a line, or None where it is not wanted. The terms are all English.

    A frequency below 0 is how often people thought the opposite: such an assertion is negated.

    Raises:
        Unreadable: the line is none; says why in a few words.
    """
    columns = columns_of(line.rstrip(b"\r"), _COLUMNS)
    named = _RELATION.search(columns[2])
    if language != "en" or (named and parse_relation(named[1].decode()) is None):
        return None
    start, end = clean(columns[0].decode()), clean(columns[1].decode())
    if named and not wanted(named[1].decode().removeprefix("Not"), start, end):
        return None
    return _assertion(start, end, columns[2], wanted)


def _assertion(start: str, end: str, literal: bytes, wanted: Wanted) -> Assertion | None:
    if len(literal) > _LONGEST_LITERAL:
        raise Unreadable("no data in it")
    data = data_of(ast.literal_eval(literal.decode()))
    relation = parse_relation(str(data.get("rel", "")))
    if relation is None or not wanted(relation[0], start, end):
        return None
    name = relation[0]
    freq, score = _number(data.get("freq")), _number(data.get("score"))
    if not 0 < score <= _MOST_VOTES:
        raise Unreadable("score is no number above 0")
    return Assertion(
        name,
        Node(start),
        Node(end),
        score,
        relation[1] != (freq < 0),
        assertion_iri(name, start, end),
        _LICENSE,
        f"{start} {'not ' if freq < 0 else ''}{name} {end}",
        adds=True,
    )


def _number(value: object) -> float:
    number = number_of(value, "freq or score is no number")
    return float(min(max(number, -_MOST_VOTES - 1), _MOST_VOTES + 1))
