"""Query evaluation: a table of plain values, or triples.

As JSON a table is a list of objects, one per row, with the keys in the order of the columns. Times
are ISO 8601, IRIs are strings, and unbound values are null.
"""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial

from pyoxigraph import (
    BlankNode,
    Literal,
    NamedNode,
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    QueryTriples,
    RdfFormat,
    Triple,
    parse,
    parse_query_results,
    serialize,
)

from kg.knowledge.ontology.declared_terms import known_terms
from kg.model import vocabulary as v
from kg.model.errors import QueryError
from kg.rdf.literals import tsv_text
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.engine_gaps import FUNCTIONS, with_total_order
from kg.rdf.sparql.lexer import has_word
from kg.rdf.sparql.vetting import check_nesting, check_no_service, check_no_update, explained
from kg.store.scheduling import yield_to_writer
from kg.store.sparql_client import Solutions, Triples

Value = str | int | float | bool | datetime | None
Row = tuple[Value, ...]

PIECE = 200  # rows read between two rests
SHOWN = 30  # rows of a printed table
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


def rows_of(solutions: QuerySolutions) -> tuple[Row, ...]:
    """All rows, evaluated and written down without the interpreter's lock."""
    text = solutions.serialize(format=QueryResultsFormat.TSV) or b""
    yield_to_writer()
    lines = io.BytesIO(text)
    lines.readline()  # the variables
    if not solutions.variables:
        return tuple(() for _ in lines)
    value, rows = _Values({"": None, **_BOOLEANS}).__getitem__, list[Row]()
    for line in lines:
        rows.append(tuple(map(value, line[:-1].decode().split("\t"))))
        if not len(rows) % PIECE:
            yield_to_writer()
            time.sleep(REST)
    return tuple(rows)


class _Values(dict[str, Value]):
    """Values by cell; most cells occur in several rows."""

    def __missing__(self, cell: str) -> Value:
        value = self[cell] = _value_in(cell)
        return value


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
    text = tsv_text(cell)
    if cell[0] in "<_":
        return text
    if cell[0] != '"':
        with suppress(ValueError):
            return int(text)
        return float(text)
    datatype = cell.rpartition('"')[2]
    return _literal_value(text, datatype[3:-1]) if datatype.startswith("^^") else text


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


def _short(cell: Value) -> str:
    """A cell for reading: IRIs in short, times to the second."""
    if isinstance(cell, datetime):
        return f"{cell:%Y-%m-%d %H:%M:%S}"
    text = "" if cell is None else v.shorten(str(cell))
    return " ".join(text.split())[:60]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of plain values under named columns; IRIs are strings, unbound is None."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = field(default=(), kw_only=True, compare=False)
    """Terms of the query that the map lacks, a sentence each; they match nothing."""

    def __str__(self) -> str:
        """Columns below each other for reading: the first rows, and how many more there are."""
        first = self.rows[:SHOWN]
        cells = [self.columns, *([_short(cell) for cell in row] for row in first)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in cells
        ]
        more = len(self.rows) - len(first)
        return "\n".join([*lines, *([f"... and {more} more rows"] if more else ())])

    def records(self) -> list[dict[str, Value]]:
        """One dict per row, by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    def to_columns(self) -> dict[str, list[Value]]:
        """A list of values per column, for `pandas.DataFrame` or `polars.DataFrame`."""
        return {name: [row[k] for row in self.rows] for k, name in enumerate(self.columns)}

    def to_json(self) -> str:
        """A JSON list of records."""
        rows = [{name: _plain(cell) for name, cell in record.items()} for record in self.records()]
        return json.dumps(rows, ensure_ascii=False, indent=2)

    def to_csv(self) -> str:
        """Comma separated values below a header line; lines end with a newline."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_plain(cell) for cell in row] for row in self.rows)
        return out.getvalue()

    def serialise(self, form: str) -> str:
        """Text in the format ``json``, ``csv`` or, for triples, ``ttl``; QueryError for another."""
        forms = {"json": self.to_json, "csv": self.to_csv, "ttl": self.to_turtle}
        if form not in forms:
            raise QueryError(f"no format {form!r} for an answer; there are: {', '.join(forms)}")
        return forms[form]()

    def to_turtle(self) -> str:
        """Turtle; raises QueryError for a table without triples."""
        raise QueryError(
            "ttl is for CONSTRUCT and DESCRIBE; this answer is a table: choose json or csv"
        )


@dataclass(frozen=True, slots=True)
class TripleTable(Table):
    """The answer of CONSTRUCT or DESCRIBE: one row per triple, and the triples."""

    triples: tuple[Triple, ...] = ()

    def to_turtle(self) -> str:
        """Turtle with the map's prefixes declared."""
        text = serialize(self.triples, format=RdfFormat.TURTLE, prefixes=v.PREFIXES)
        return (text or b"").decode()


def evaluate(
    engine: QuadStore,
    sparql: str,
    name: str = "query",
    *,
    base: str | None = None,
    shipped: bool = False,
) -> Table:
    """The answer of `engine` to a SPARQL query over the union of all named graphs.

    Prefixes of the vocabulary need no declaration; relative IRIs are of `base`; a FROM clause
    narrows the union. A `shipped` query is taken as it is; others are checked, and an ORDER BY over
    mixed values cannot abort the process (`kg.rdf.sparql.engine_gaps`). Raises QueryError, in one
    line, for a query that does not parse (with the position), writes, or reads other sources.
    """
    yield_to_writer()
    if not shipped:
        check_nesting(sparql)
        check_no_service(sparql)
        check_no_update(sparql)

    def run(text: str) -> Table:
        results = engine.query(
            text,
            base_iri=base,
            prefixes=v.PREFIXES,
            use_default_graph_as_union=not has_word(sparql, "from"),
            custom_functions=FUNCTIONS,
        )
        return answer_of(results)

    try:
        rewritten = sparql if shipped else with_total_order(sparql)
        if rewritten != sparql:
            with suppress(SyntaxError):  # raised again for the text as it was written
                return run(rewritten)
        return run(sparql)
    except SyntaxError as error:
        cause = explained(sparql, str(error), terms=partial(known_terms, engine))
        raise QueryError(f"{name}: {cause}") from error
    except (OSError, RuntimeError, ValueError) as error:
        raise QueryError(f"{name}: {' '.join(str(error).split())}") from error


def answer_of(
    results: QuerySolutions | Solutions | QueryBoolean | QueryTriples | Triples,
) -> Table:
    """The results of an engine as a table of plain values."""
    if isinstance(results, QueryBoolean):
        return Table(("answer",), ((bool(results),),))
    if isinstance(results, QueryTriples | Triples):
        found: Iterable[Triple] = results
        if isinstance(results, QueryTriples):
            # evaluated whole, without the interpreter's lock
            text = results.serialize(format=RdfFormat.N_TRIPLES) or b""
            found = (quad.triple for quad in parse(text, format=RdfFormat.N_TRIPLES))
        triples = tuple(sorted(set(found), key=str))
        rows = _rows((t.subject, t.predicate, t.object) for t in triples)
        return TripleTable(("subject", "predicate", "object"), rows, triples)
    columns = tuple(variable.value for variable in results.variables)
    if isinstance(results, QuerySolutions):
        return Table(columns, rows_of(results))
    return Table(columns, _rows(tuple(solution) for solution in results))


def _rows(terms: Iterable[Iterable[object]]) -> tuple[tuple[Value, ...], ...]:
    return tuple(tuple(value_of(term) for term in row) for row in terms)


def _plain(value: Value) -> str | int | float | bool | None:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
