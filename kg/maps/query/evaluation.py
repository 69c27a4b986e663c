"""Query evaluation: a table of plain values, or triples.

As JSON a table is a list of objects, one per row, with the keys in the order of the columns. Times
are ISO 8601, IRIs are strings, and unbound values are null.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial

from pyoxigraph import (
    QueryBoolean,
    QuerySolutions,
    QueryTriples,
    RdfFormat,
    Triple,
    parse,
    serialize,
)

from kg.knowledge.ontology.declared_terms import known_terms
from kg.maps.query.result_rows import Row, Value, rows_of, value_of
from kg.model import vocabulary as v
from kg.model.errors import QueryError
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.extension_functions import FUNCTIONS
from kg.rdf.sparql.order_by import with_total_order
from kg.rdf.sparql.parameters import has_word
from kg.rdf.sparql.subclass_inference import superclasses_of, with_subclasses
from kg.rdf.sparql.syntax_errors import explained
from kg.rdf.sparql.vetting import check_no_service, check_no_update
from kg.store.sparql_client import Solutions, Triples
from kg.store.writer_priority import yield_to_writer


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of plain values under named columns; IRIs are strings, unbound is None."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = field(default=(), kw_only=True, compare=False)
    """Terms of the query that the map lacks, a sentence each; they match nothing."""

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
        if form == "json":
            return self.to_json()
        if form == "csv":
            return self.to_csv()
        if form == "ttl":
            return self.to_turtle()
        raise QueryError(f"no format {form!r} for an answer; there are: json, csv, ttl")

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
    total_order: bool = False,
    subclasses: bool = False,
) -> Table:
    """The answer of `engine` to a SPARQL query over the union of all named graphs.

    Prefixes of the vocabulary need no declaration; relative IRIs are of `base`; a FROM clause
    narrows the union. With `total_order` an ORDER BY over mixed values cannot abort the process
    (`kg.rdf.sparql.order_by`), with `subclasses` a class stands for its subclasses too
    (`kg.rdf.sparql.subclass_inference`). Raises QueryError, in one line, for a query that does not
    parse (with the position), writes, or reads other sources.
    """
    yield_to_writer()
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
        rewritten = with_total_order(sparql) if total_order else sparql
        if subclasses:
            rewritten = with_subclasses(rewritten, superclasses_of(engine))
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
            # as in `kg.maps.query.result_rows`: evaluated whole, without the interpreter's lock
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
