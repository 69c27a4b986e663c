"""What a question is answered with: a table of plain values, or triples.

As JSON a table is a list of records, one object a row, keys in the order of the columns: what jq,
pandas and people expect. Times are ISO 8601, IRIs strings, what is unbound null.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from pyoxigraph import (
    QueryBoolean,
    QuerySolutions,
    QueryTriples,
    RdfFormat,
    Triple,
    parse,
    serialize,
)

from kg import vocabulary as v
from kg.endpoint import Solutions, Triples
from kg.engine import Engine
from kg.errors import QueryError
from kg.functions import FUNCTIONS
from kg.right_of_way import give_way
from kg.rows import Row, Value, rows_of, value_of
from kg.sparql_text import has_word, refuse_reaching_out, refuse_update

__all__ = [
    "Row",
    "Table",
    "TripleTable",
    "Value",
    "evaluate",
    "located",
    "value_of",
]

SAID = 6  # alternatives named where a query does not parse


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of plain values under named columns; IRIs are strings, unbound is None."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    def records(self) -> list[dict[str, Value]]:
        """One dict a row, keyed by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    def to_columns(self) -> dict[str, list[Value]]:
        """A list of values a column: what `pandas.DataFrame` and `polars.DataFrame` take."""
        return {name: [row[k] for row in self.rows] for k, name in enumerate(self.columns)}

    def to_json(self) -> str:
        """A JSON list of records."""
        rows = [{name: _plain(cell) for name, cell in record.items()} for record in self.records()]
        return json.dumps(rows, ensure_ascii=False, indent=2)

    def to_csv(self) -> str:
        """Comma separated values under a header line, lines ended by a newline alone."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_plain(cell) for cell in row] for row in self.rows)
        return out.getvalue()

    def serialise(self, form: str) -> str:
        """As text in the form ``json``, ``csv`` or, for triples, ``ttl``; QueryError otherwise."""
        if form == "json":
            return self.to_json()
        if form == "csv":
            return self.to_csv()
        if form == "ttl":
            return self.to_turtle()
        raise QueryError(f"no format {form!r} for an answer; there are: json, csv, ttl")

    def to_turtle(self) -> str:
        """Turtle, which only an answer made of triples has."""
        raise QueryError(
            "ttl is for CONSTRUCT and DESCRIBE; this answer is a table: choose json or csv"
        )


@dataclass(frozen=True, slots=True)
class TripleTable(Table):
    """The answer of CONSTRUCT or DESCRIBE: a row a triple, and the triples themselves."""

    triples: tuple[Triple, ...] = ()

    def to_turtle(self) -> str:
        """Turtle with the map's prefixes declared."""
        text = serialize(self.triples, format=RdfFormat.TURTLE, prefixes=v.PREFIXES)
        return (text or b"").decode()


def evaluate(engine: Engine, sparql: str, name: str = "query", *, base: str | None = None) -> Table:
    """The answer of `engine` to a SPARQL query over the union of all named graphs.

    Prefixes of the vocabulary need no declaration; relative IRIs are of `base`; a FROM clause
    narrows the union. Raises QueryError, in one line, for what does not parse (saying where),
    writes, or reaches out.
    """
    give_way()
    refuse_reaching_out(sparql)
    refuse_update(sparql)
    try:
        results = engine.query(
            sparql,
            base_iri=base,
            prefixes=v.PREFIXES,
            use_default_graph_as_union=not has_word(sparql, "from"),
            custom_functions=FUNCTIONS,
        )
        return _answer(results)
    except SyntaxError as error:
        raise QueryError(f"{name}: {located(str(error))}") from error
    except (OSError, RuntimeError, ValueError) as error:
        raise QueryError(f"{name}: {' '.join(str(error).split())}") from error


def _answer(results: QuerySolutions | Solutions | QueryBoolean | QueryTriples | Triples) -> Table:
    if isinstance(results, QueryBoolean):
        return Table(("answer",), ((bool(results),),))
    if isinstance(results, QueryTriples | Triples):
        triples = tuple(sorted(set(_triples(results)), key=str))
        rows = _rows((t.subject, t.predicate, t.object) for t in triples)
        return TripleTable(("subject", "predicate", "object"), rows, triples)
    columns = tuple(variable.value for variable in results.variables)
    if isinstance(results, QuerySolutions):
        return Table(columns, rows_of(results))
    return Table(columns, _rows(tuple(solution) for solution in results))


def _triples(results: QueryTriples | Triples) -> Iterable[Triple]:
    if isinstance(results, Triples):
        return results
    # as in `kg.rows`: evaluated whole, without the interpreter's lock
    text = results.serialize(format=RdfFormat.N_TRIPLES) or b""
    return (quad.triple for quad in parse(text, format=RdfFormat.N_TRIPLES))


def _rows(terms: Iterable[Iterable[object]]) -> tuple[tuple[Value, ...], ...]:
    return tuple(tuple(value_of(term) for term in row) for row in terms)


def _plain(value: Value) -> str | int | float | bool | None:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def located(message: str, shift: int = 0) -> str:
    """The engine's complaint about a syntax in one line; `shift` columns of line 1 are not ours."""
    place, _, reason = message.removeprefix("error at ").partition(": ")
    line, colon, column = place.partition(":")
    if not (colon and line.isdigit() and column.isdigit()):
        return " ".join(message.split())
    at = max(int(column) - (shift if line == "1" else 0), 1)
    return f"does not parse at line {line}, column {at}: {' '.join(_shortened(reason).split())}"


def _shortened(reason: str) -> str:
    """The engine lists all it could have read on; the first few tell as much."""
    options = reason.removeprefix("expected one of ").split(", ")
    if len(options) <= SAID:
        return reason
    return f"expected {', '.join(options[:SAID])}, ..."
