"""Several maps, one question: each member is asked by itself, and the rows put together.

Scatter and gather, not SPARQL federation: a join over SERVICE is not pushed down by the engines,
and a member that is away would take the whole answer with it. Each row says whose it is. What
groups or counts does so within a member. The order of the question and its LIMIT hold over all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from pyoxigraph import Literal, NamedNode, QuerySolutions, Store

from kg import vocabulary as v
from kg.answers import Row, Table, Value
from kg.endpoint import is_url, without_secrets
from kg.errors import GraphError, HereaboutsError, QueryError
from kg.questions import LIKE_AN_IRI, any_question
from kg.semantic_map import SemanticMap
from kg.sparql_text import after_where, tail_of

MEMBER = "member"
ROW = "hereaboutsRow"
BOUND = 2000  # rows that are bound at once


@dataclass(frozen=True, slots=True)
class FleetAnswer:
    """What the members that answered said, and why the others did not."""

    table: Table  # the first column is `member`
    failures: Mapping[str, str]  # member -> one line


class Fleet:
    """Maps to be asked together: folders, or addresses of SPARQL servers.

    A member is opened when it is asked for the first time, and again after it failed; so a fleet
    can be made while a member is away. A context manager that closes them all.
    """

    def __init__(self, members: Sequence[str]) -> None:
        if len(set(members)) < len(members) or not members:
            raise GraphError(f"a fleet needs members, each once, got: {', '.join(members)}")
        self.members = tuple(members)
        self._open: dict[str, SemanticMap] = {}

    def query(self, question: str | Path, **parameters: object) -> FleetAnswer:
        """The answers of all members to any question that `SemanticMap.query` takes.

        Raises QueryError for a question that is wrong for all of them, or that has an OFFSET;
        GraphError where no member answers.
        """
        asked = any_question(question, parameters)
        return self.gather(lambda member: member.query(question, **parameters), asked.sparql)

    def bound(self, rows: Table, sparql: str) -> FleetAnswer:
        """What all members say to a SELECT or ASK, its variables bound to `rows` of another answer.

        So maps are joined: what one said goes to the others in a VALUES block, once, where a
        SERVICE clause would be asked row by row or for everything. Columns are variables (but for
        `member`); text that starts like ``http://`` or ``urn:`` is an IRI. Raises QueryError for
        more than 2,000 different rows, and as `query`.
        """
        names = [name for name in rows.columns if name != MEMBER]
        wanted = dict.fromkeys(tuple(row[name] for name in names) for row in rows.records())
        if not names or len(wanted) > BOUND:
            raise QueryError(
                f"binds 1 column or more in up to {BOUND:,} rows, got {len(names)} in "
                f"{len(wanted):,}; ask for fewer, or DISTINCT"
            )
        lines = " ".join(f"({' '.join(map(_term, row))})" for row in wanted)
        block = f" VALUES ({' '.join(f'?{name}' for name in names)}) {{ {lines} }}"
        return self.gather(lambda member: member.ask_text(after_where(sparql, block)), sparql)

    def gather(self, ask: Callable[[SemanticMap], Table], sparql: str) -> FleetAnswer:
        """The answers of `ask`, in the order and number that the query text `sparql` wants."""
        tail = tail_of(sparql)
        if tail.offset:
            raise QueryError("OFFSET cannot be kept over several maps; use LIMIT, or ask one map")
        with ThreadPoolExecutor(len(self.members)) as pool:
            told = dict(
                zip(
                    self.members,
                    pool.map(lambda name: self._ask(name, ask), self.members),
                    strict=True,
                )
            )
        # rows and reasons are shown: an address without its password
        shown = {(without_secrets(n) if is_url(n) else n): answer for n, answer in told.items()}
        tables = {name: answer for name, answer in shown.items() if isinstance(answer, Table)}
        failed = {name: error for name, error in shown.items() if not isinstance(error, Table)}
        failures = {name: " ".join(str(error).split()) for name, error in failed.items()}
        if not tables:
            raise _shared_failure(list(failed.values()), failures)
        table = merged(tables, tail.order, tail.limit)
        return FleetAnswer(table, failures)

    def close(self) -> None:
        """Close all members."""
        while self._open:
            self._open.popitem()[1].close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _ask(self, name: str, ask: Callable[[SemanticMap], Table]) -> Table | HereaboutsError:
        try:
            if name not in self._open:
                self._open[name] = SemanticMap.open(name, read_only=True)
            return ask(self._open[name])
        except HereaboutsError as error:
            if isinstance(error, GraphError) and name in self._open:
                self._open.pop(name).close()
            return error


def merged(tables: Mapping[str, Table], order: str, limit: int | None) -> Table:
    """One table of all rows with their member in front, ordered and cut as one answer would be.

    `order` is the text of an ORDER BY clause over selected columns, or empty. Raises QueryError
    where the members' columns differ.
    """
    columns = next(iter(tables.values())).columns
    for name, table in tables.items():
        if table.columns != columns:
            raise QueryError(
                f"the members answer with different columns: {', '.join(columns)}; "
                f"but {name}: {', '.join(table.columns)}"
            )
    rows = [(name, *row) for name, table in tables.items() for row in table.rows]
    rows = _ordered(rows, columns, order) if order and len(tables) > 1 else rows
    return Table((MEMBER, *columns), tuple(rows[:limit]))


def _ordered(rows: list[Row], columns: Sequence[str], order: str) -> list[Row]:
    """The rows in the order that SPARQL itself puts them, its own engine asked; ties stay."""
    variables = " ".join(f"?{column}" for column in columns)
    values = "\n".join(
        f"({number} {' '.join(_written(value) for value in row[1:])})"
        for number, row in enumerate(rows)
    )
    results = Store().query(
        f"SELECT ?{ROW} WHERE {{ VALUES (?{ROW} {variables}) {{\n{values}\n}} }} {order}\n?{ROW}",
        prefixes=v.PREFIXES,
    )
    assert isinstance(results, QuerySolutions)
    return [rows[int(solution[0].value)] for solution in results]


def _written(value: Value) -> str:
    """A value as it sorts; IRIs as text, which within a column is the same order."""
    if value is None:
        return "UNDEF"
    if isinstance(value, datetime):
        return str(Literal(value.isoformat(), datatype=NamedNode(v.XSD + "dateTime")))
    return str(Literal(value))


def _term(value: Value) -> str:
    """A value as the term it most likely was: texts that look like IRIs are IRIs."""
    if isinstance(value, str) and LIKE_AN_IRI.match(value):
        return str(NamedNode(value))
    return _written(value)


def _shared_failure(
    errors: Sequence[HereaboutsError], failures: Mapping[str, str]
) -> HereaboutsError:
    if not any(isinstance(error, GraphError) for error in errors):
        return errors[0]  # the question is wrong, not the members
    said = "; ".join(f"{name}: {reason}" for name, reason in failures.items())
    return GraphError(f"no member answered: {said}")
