"""Result rows as plain values, parsed from the engine's tab-separated results.

Each step of the engine's result iterator takes the interpreter's lock, and Python code holds it
between the steps, so two reading threads keep a third one from writing. Therefore the engine
evaluates and serialises a whole result without the lock. Parsing that text is quick, and pauses
after every few hundred rows.
"""

from __future__ import annotations

import io
import re
import time
from datetime import datetime

from pyoxigraph import (
    BlankNode,
    Literal,
    NamedNode,
    QueryResultsFormat,
    QuerySolutions,
    parse_query_results,
)

from kg.model import vocabulary as v
from kg.store.writer_priority import yield_to_writer

Value = str | int | float | bool | datetime | None
Row = tuple[Value, ...]

PIECE = 200  # rows read between two rests
REST = 1e-4  # [s] long enough for a waiting thread to take the lock, and no longer

_FLOATS = {v.XSD + name for name in ("double", "float", "decimal")}
_INTEGERS = {
    v.XSD + name
    for name in (
        *("integer", "int", "long", "short", "byte"),
        *("nonNegativeInteger", "positiveInteger", "nonPositiveInteger", "negativeInteger"),
        *("unsignedInt", "unsignedLong", "unsignedShort", "unsignedByte"),
    )
}
_BOOLEANS = {"true": True, "false": False}
_ESCAPE = re.compile(r"\\(.)")
_ESCAPED = {"t": "\t", "n": "\n", "r": "\r", "b": "\b", "f": "\f"}


def rows_of(solutions: QuerySolutions) -> tuple[Row, ...]:
    """All rows, evaluated and written down without the interpreter's lock."""
    text = solutions.serialize(format=QueryResultsFormat.TSV) or b""
    yield_to_writer()
    lines = io.BytesIO(text)
    lines.readline()  # the variables
    if not solutions.variables:
        return tuple(() for _ in lines)
    known: dict[str, Value] = {"": None, **_BOOLEANS}
    rows: list[Row] = []
    for line in lines:
        row = []
        for cell in line[:-1].decode().split("\t"):
            try:
                row.append(known[cell])
            except KeyError:
                row.append(known.setdefault(cell, _value_in(cell)))
        rows.append(tuple(row))
        if not len(rows) % PIECE:
            yield_to_writer()
            time.sleep(REST)
    return tuple(rows)


def value_of(term: object) -> Value:
    """Plain value of a term; its lexical form where Python has no such value."""
    if term is None:
        return None
    if isinstance(term, NamedNode):
        return term.value
    if isinstance(term, BlankNode):
        return f"_:{term.value}"
    if not isinstance(term, Literal):
        return str(term)
    return _literal_value(term.value, term.datatype.value)


def _value_in(cell: str) -> Value:
    """Value of a term in a TSV cell, where numbers may be unquoted."""
    if cell.startswith("<<"):
        return _triple_in(cell)
    if cell[0] == "<":
        return cell[1:-1]
    if cell[0] == "_":
        return cell
    if cell[0] != '"':
        return _number_in(cell)
    end = cell.rindex('"')
    text = cell[1:end]
    if "\\" in text:
        text = _ESCAPE.sub(lambda match: _ESCAPED.get(match[1], match[1]), text)
    datatype = cell[end + 1 :]
    return _literal_value(text, datatype[3:-1]) if datatype.startswith("^^") else text


def _number_in(cell: str) -> int | float:
    try:
        return int(cell)
    except ValueError:
        return float(cell)


def _triple_in(cell: str) -> str:
    answer = parse_query_results(f"?t\n{cell}\n".encode(), format=QueryResultsFormat.TSV)
    assert isinstance(answer, QuerySolutions)
    return str(next(answer)["t"])


def _literal_value(text: str, datatype: str) -> Value:
    try:
        if datatype in _FLOATS:
            return float(text)
        if datatype in _INTEGERS:
            return int(text)
        if datatype == v.XSD + "boolean":
            return text in ("true", "1")
        if datatype == v.XSD + "dateTime":
            return datetime.fromisoformat(text)
    except ValueError:
        pass
    return text
