"""SPARQL Update as text: which operations a request holds, and the parts of each.

The engine's own parser has the last word on the syntax (`kg.outside` asks it first, for the whole
request, and again for every part); here the text is only cut, outside of strings, comments and
IRIs. Grammar: SPARQL 1.1, rules 29 to 49.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from kg.errors import QueryError
from kg.sparql_text import STRING, refuse_reaching_out, without_escapes

#: Stands for a variable where a template is read as if it were data.
VARIABLE: Final = "urn:hereabouts:variable:"

_TOKEN = re.compile(
    rf"""
      (?P<skip> \#[^\n\r]*)
    | (?P<iri> <(?:[^<>"{{}}|^`\\\x00-\x20] | \\u[0-9a-fA-F]{{4}} | \\U[0-9a-fA-F]{{8}})*>)
    | (?P<string> {STRING})
    | (?P<variable> [?$]\w+)
    | (?P<name> _?(?:\w[\w.-]*)?:(?:[\w:%.-] | \\.)*)
    | (?P<word> @?\w+)
    | (?P<mark> [{{}};])
    """,
    re.VERBOSE | re.DOTALL,
)
_GAP = r"(?:\s|\#[^\n\r]*[\n\r])*"
# over the raw text, as for SERVICE: a false alarm costs a rewording, a miss a way to the network
_LOAD = re.compile(rf"\bload{_GAP}(?:silent{_GAP})?(?:<[^>]*>|[\w.-]*:\w)", re.IGNORECASE)
_ONE_GRAPH = ("CLEAR", "DROP", "CREATE")
_TWO_GRAPHS = ("ADD", "COPY", "MOVE")


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation of a request; the parts are text as written, groups with their braces."""

    verb: str  # INSERT DATA, DELETE DATA, MODIFY, CLEAR, DROP, CREATE, ADD, COPY, MOVE, LOAD
    prologue: str  # the PREFIX and BASE declarations in force, on one line
    text: str = ""  # the whole operation
    start: int = 0  # where in the request it stands
    delete: str = "{}"  # template
    insert: str = "{}"  # template, or the data of INSERT DATA
    where: str = "{}"  # group
    within: str = ""  # the graph of WITH
    using: str = ""  # USING clauses, as the FROM clauses of a query
    silent: bool = False
    graphs: tuple[str, ...] = ()  # of CLEAR ... MOVE: an IRI, or DEFAULT, NAMED, ALL


class UnclearError(QueryError):
    """The parts of an operation cannot be told apart; the engine's parser may know why."""


class _Token(NamedTuple):
    kind: str
    text: str
    start: int
    end: int

    @property
    def keyword(self) -> str:
        return self.text.upper() if self.kind == "word" else ""


def refuse_loading(sparql: str) -> None:
    """Raises QueryError where the text has SERVICE or LOAD, which would reach out of the map."""
    refuse_reaching_out(sparql)
    if _LOAD.search(sparql) or _LOAD.search(without_escapes(sparql)):
        raise QueryError("LOAD is refused: an update reaches nothing outside; write INSERT DATA")


def operations(sparql: str, prologue: str = "") -> Iterator[Operation]:
    """The operations of an update request, in their order.

    What is declared in `prologue` is in force from the start.
    Raises QueryError where there is no such operation, UnclearError where they run together.
    """
    for tokens, start, end in _split(sparql):
        cut = _after_prologue(tokens)
        prologue += "".join(f"{token.text} " for token in tokens[:cut])
        if tokens[cut:]:
            start = tokens[cut - 1].end if cut else start
            operation = _Parts(sparql, tokens[cut:]).operation(prologue)
            yield replace(operation, text=sparql[start:end], start=start)


def marked(template: str) -> str:
    """A template as data: each variable is an IRI under `VARIABLE`."""

    def written(match: re.Match[str]) -> str:
        name = match["variable"]
        return f" <{VARIABLE}{name[1:]}> " if name else match[0]

    return _TOKEN.sub(written, template)


def _tokens(sparql: str) -> Iterator[_Token]:
    for match in _TOKEN.finditer(sparql):
        if match.lastgroup is not None and match.lastgroup != "skip":
            yield _Token(match.lastgroup, match[0], match.start(), match.end())


def _split(sparql: str) -> Iterator[tuple[list[_Token], int, int]]:
    """Tokens between the semicolons that separate operations, and where these stand."""
    depth, start, found = 0, 0, list[_Token]()
    for token in _tokens(sparql):
        if token.kind == "mark":
            depth += {"{": 1, "}": -1}.get(token.text, 0)
        if token.text == ";" and token.kind == "mark" and depth == 0:
            yield found, start, token.start
            start, found = token.end, []
        else:
            found.append(token)
    yield found, start, len(sparql)


def _after_prologue(tokens: list[_Token]) -> int:
    at = 0
    while at < len(tokens) and tokens[at].keyword in ("PREFIX", "BASE"):
        at += 3 if tokens[at].keyword == "PREFIX" else 2
    return at


class _Parts:
    """Reads the tokens of one operation from left to right."""

    def __init__(self, sparql: str, tokens: list[_Token]) -> None:
        self._sparql, self._tokens, self._at = sparql, tokens, 0

    def operation(self, prologue: str) -> Operation:
        first = self._tokens[0].keyword
        second = self._tokens[1].keyword if len(self._tokens) > 1 else ""
        if first in ("INSERT", "DELETE") and second == "DATA":
            self._at = 2
            data = self._group()
            if first == "INSERT":
                return Operation("INSERT DATA", prologue, insert=data)
            return Operation("DELETE DATA", prologue, delete=data)
        if first == "DELETE" and second == "WHERE":
            self._at = 2
            pattern = self._group()
            return Operation("MODIFY", prologue, delete=pattern, where=pattern)
        if first in ("WITH", "INSERT", "DELETE"):
            return self._modify(Operation("MODIFY", prologue))
        return self._management(prologue)

    def _modify(self, operation: Operation) -> Operation:
        using = ""
        while self._at < len(self._tokens):
            word = self._take().keyword
            if word == "WITH":
                operation = replace(operation, within=self._take().text)
            elif word == "DELETE":
                operation = replace(operation, delete=self._group())
            elif word == "INSERT":
                operation = replace(operation, insert=self._group())
            elif word == "USING":
                graph = self._take()
                named = "NAMED " if graph.keyword == "NAMED" else ""
                using += f"FROM {named}{(self._take() if named else graph).text}\n"
            elif word == "WHERE":
                operation = replace(operation, where=self._group(), using=using)
            else:
                raise self._unclear()
        return operation

    def _management(self, prologue: str) -> Operation:
        words = [t.keyword for t in self._tokens]
        if words[0] not in (*_ONE_GRAPH, *_TWO_GRAPHS):
            raise QueryError(
                f"{self._tokens[0].text} is no operation of an update; there are: INSERT, DELETE, "
                f"WITH, {', '.join((*_ONE_GRAPH, *_TWO_GRAPHS))}"
            )
        plain = [t for t in self._tokens[1:] if t.keyword not in ("SILENT", "GRAPH", "TO", "INTO")]
        graphs = tuple(t.keyword or t.text for t in plain)
        if len(graphs) != (2 if words[0] in _TWO_GRAPHS else 1):
            raise self._unclear()
        return Operation(words[0], prologue, silent="SILENT" in words, graphs=graphs)

    def _take(self) -> _Token:
        if self._at >= len(self._tokens):
            raise self._unclear()
        self._at += 1
        return self._tokens[self._at - 1]

    def _group(self) -> str:
        start = self._take()
        depth, token = 1, start
        while depth:
            token = self._take()
            if token.kind == "mark":
                depth += {"{": 1, "}": -1}.get(token.text, 0)
        return self._sparql[start.start : token.end]

    def _unclear(self) -> UnclearError:
        return UnclearError(
            f"the update's {self._tokens[0].text} cannot be taken apart; "
            "put spaces around < and > where they compare"
        )
