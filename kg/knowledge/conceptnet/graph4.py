"""Parser of the ConceptNet 4 graph: start, end and a Python dictionary of freq, score and rel."""

from __future__ import annotations

import ast
import re
from typing import Final

from kg.knowledge.conceptnet.edges import (
    Edge,
    EdgeFilter,
    MalformedEdgeError,
    Node,
    assertion_iri,
    clean,
    columns_of,
    data_of,
    license_iri,
    number_of,
    parse_relation,
)

_COLUMNS: Final = 3
_MAX_LITERAL_LENGTH: Final = 1000  # bytes; bounds the nesting of hostile input
_MAX_VOTES: Final = 1e6
_RELATION: Final = re.compile(rb"'rel': u?'(\w+)'")
_LICENSE: Final = license_iri("cc:by-sa/4.0")


def looks_like(line: bytes) -> bool:
    """Whether a line has the form of an assertion of ConceptNet 4."""
    columns = line.split(b"\t")
    return len(columns) == _COLUMNS and columns[2].startswith(b"{") and b"'rel'" in columns[2]


def parse(line: bytes, language: str, wanted: EdgeFilter) -> Edge | None:
    """The assertion of a line, or None if the filter rejects it. All terms are English.

    An assertion with a frequency below 0 is negated.

    Raises:
        MalformedEdgeError: the line is no valid assertion.
    """
    columns = columns_of(line.rstrip(b"\r"), _COLUMNS)
    named = _RELATION.search(columns[2])
    if language != "en" or (named and parse_relation(named[1].decode()) is None):
        return None
    start, end = clean(columns[0].decode()), clean(columns[1].decode())
    if named and not wanted(named[1].decode().removeprefix("Not"), start, end):
        return None
    return _assertion(start, end, columns[2], wanted)


def _assertion(start: str, end: str, literal: bytes, wanted: EdgeFilter) -> Edge | None:
    if len(literal) > _MAX_LITERAL_LENGTH:
        raise MalformedEdgeError("no data in it")
    data = data_of(ast.literal_eval(literal.decode()))
    relation = parse_relation(str(data.get("rel", "")))
    if relation is None or not wanted(relation[0], start, end):
        return None
    name = relation[0]
    freq, score = _number(data.get("freq")), _number(data.get("score"))
    if not 0 < score <= _MAX_VOTES:
        raise MalformedEdgeError("score is no number above 0")
    return Edge(
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
    return float(min(max(number, -_MAX_VOTES - 1), _MAX_VOTES + 1))
