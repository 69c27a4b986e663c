"""Answers of several maps, put together: rows with their member, triples, or a truth value.

What members say is SPARQL results JSON and N-Triples. Rows are put in order by the engine itself,
in a worker, since the ORDER BY is a stranger's.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pyoxigraph import (
    BlankNode,
    Literal,
    NamedNode,
    QueryResultsFormat,
    RdfFormat,
    Triple,
    parse,
    parse_query_results,
    serialize,
)

from kg import vocabulary as v
from kg.characters import in_xml, is_xml
from kg.errors import QueryError, QueryTooLargeError, RemoteError
from kg.fleet import MEMBER, ROW
from kg.server.media_types import GRAPH_FORMATS, SOLUTIONS, document
from kg.sparql_text import Tail
from kg.workers.pool import QueryPool

SORTED = 8 << 20  # characters of rows that are put in order at most

Row = dict[str, Any]  # a binding of SPARQL results JSON


def rows_of(answers: Mapping[str, bytes], columns: Sequence[str]) -> list[Row]:
    """All rows, each with its member; raises RemoteError where an answer is cut short."""
    found: list[Row] = []
    for number, (name, body) in enumerate(answers.items()):
        member = {"type": "literal", "value": name}
        try:
            for row in _parsed(name, body)["results"]["bindings"]:
                kept = {key: _apart(term, number) for key, term in row.items() if key in columns}
                found.append({MEMBER: member, **kept})
        except (KeyError, TypeError, AttributeError) as error:
            raise RemoteError(f"{name} answered a SELECT with something else") from error
    return found


def any_true(answers: Mapping[str, bytes]) -> bool:
    """Whether an ASK is true of a member."""
    return any(_parsed(name, body).get("boolean") is True for name, body in answers.items())


def triples_of(answers: Mapping[str, bytes]) -> dict[Triple, None]:
    """All triples once; blank nodes of different members stay apart."""
    found: dict[Triple, None] = {}
    for number, (name, body) in enumerate(answers.items()):
        try:
            for quad in parse(body, format=RdfFormat.N_TRIPLES):
                subject, target = _renamed(quad.subject, number), _renamed(quad.object, number)
                found[Triple(subject, quad.predicate, target)] = None
        except (SyntaxError, ValueError) as error:
            raise RemoteError(f"{name} broke off its answer; ask for less") from error
    return found


def in_order(
    rows: list[Row], columns: Sequence[str], tail: Tail, prologue: str, engine: QueryPool
) -> list[Row]:
    """The rows as the query's own ORDER BY and LIMIT want them.

    Raises QueryError where the order is by something that is not selected, and QueryTooLargeError
    where there is too much to be put in order.
    """
    if tail.order:
        wanted = list(dict.fromkeys(re.findall(r"[?$](\w+)", tail.order)))
        missing = [name for name in wanted if name not in (MEMBER, *columns)]
        if missing:
            raise QueryError(
                f"ORDER BY ?{missing[0]} needs ?{missing[0]} among the selected columns where "
                "several maps are asked"
            )
        query = (
            f"{prologue} SELECT ?{ROW} WHERE {{ {values(rows, wanted, numbered=True)} }} "
            f"{tail.order}\n?{ROW}"
        )
        said = json.loads(engine.run(query, accept=SOLUTIONS).body)
        rows = [rows[int(row[ROW]["value"])] for row in said["results"]["bindings"]]
    return rows[: tail.limit]


def values(rows: Sequence[Row], columns: Sequence[str], *, numbered: bool = False) -> str:
    """The rows as a VALUES block; with `numbered`, the number of each in front.

    Raises QueryTooLargeError where it would be too long.
    """
    head = [ROW, *columns] if numbered else list(columns)
    lines, size = [], 0
    for number, row in enumerate(rows):
        cells = [_written(row.get(column)) for column in columns]
        line = f"({' '.join([str(number), *cells] if numbered else cells)})"
        size += len(line)
        if size > SORTED:
            raise QueryTooLargeError(
                f"the members' rows have over {SORTED:,} characters to put in order; ask for fewer"
            )
        lines.append(line)
    variables = " ".join(f"?{name}" for name in head)
    return f"VALUES ({variables}) {{ {' '.join(lines)} }}"


def written_rows(rows: Sequence[Row], columns: Sequence[str], media_type: str) -> bytes:
    """Rows as a table in that format, the member in front."""
    head = {"vars": [MEMBER, *columns]}
    return _results({"head": head, "results": {"bindings": rows}}, media_type)


def written_truth(truth: bool, media_type: str) -> bytes:
    """A truth value in that format."""
    return _results({"head": {}, "boolean": truth}, media_type)


def written_triples(triples: Iterable[Triple], media_type: str) -> bytes:
    """Triples in that format."""
    if media_type in GRAPH_FORMATS:
        return document(triples, media_type, v.PREFIXES)
    form = RdfFormat.from_media_type(media_type)
    body = serialize(triples, format=form, prefixes=v.PREFIXES) or b""
    return in_xml(body) if is_xml(media_type) else body


def _results(told: Mapping[str, object], media_type: str) -> bytes:
    body = json.dumps(told, ensure_ascii=False, separators=(",", ":")).encode()
    if media_type == SOLUTIONS:
        return body
    form = QueryResultsFormat.from_media_type(media_type)
    written = parse_query_results(body, format=QueryResultsFormat.JSON).serialize(format=form)
    return in_xml(written or b"") if is_xml(media_type) else written or b""


def _parsed(name: str, body: bytes) -> dict[str, Any]:
    try:
        told: dict[str, Any] = json.loads(body)
    except ValueError as error:
        raise RemoteError(
            f"{name} broke off its answer, most likely at its time limit; ask for less"
        ) from error
    return told


def _apart(term: dict[str, Any], number: int) -> dict[str, Any]:
    if term["type"] == "bnode":
        return {**term, "value": f"m{number}{term['value']}"}
    return term


def _renamed(term: Any, number: int) -> Any:
    return BlankNode(f"m{number}{term.value}") if isinstance(term, BlankNode) else term


def _written(term: Mapping[str, Any] | None) -> str:
    """A term in SPARQL; blank nodes cannot stand in VALUES, and sort before all else unbound."""
    kind = term["type"] if term else "bnode"
    if term is None or kind not in ("uri", "literal", "typed-literal"):
        return "UNDEF"
    try:
        if kind == "uri":
            return str(NamedNode(term["value"]))
        if "xml:lang" in term:
            return str(Literal(term["value"], language=term["xml:lang"]))
        datatype = term.get("datatype")
        return str(Literal(term["value"], datatype=NamedNode(datatype) if datatype else None))
    except ValueError as error:
        raise RemoteError(f"a member answered with no term of RDF: {str(term)[:100]}") from error
