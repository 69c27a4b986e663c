"""Parser of SPARQL Update requests: the operations of a request, and the parts of each.

The engine's own parser checks the syntax (`kg.maps.update.execution` runs it first for the whole
request, and again for every part). This parser only splits the text, outside of strings, comments
and IRIs. Grammar: SPARQL 1.1, rules 29 to 49.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from pyoxigraph import NamedNode

from kg.model.errors import QueryError, did_you_mean
from kg.rdf.sparql.lexer import Token, has_word, replace_tokens, tokens_of

#: Prefix of the IRIs that replace variables where a template is parsed as data.
VARIABLE: Final = "urn:hereabouts:variable:"

_ONE_GRAPH = ("CLEAR", "DROP", "CREATE")
_TWO_GRAPHS = ("ADD", "COPY", "MOVE")


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation of a request; its parts are unchanged text, groups with their braces."""

    verb: str  # INSERT DATA, DELETE DATA, MODIFY, CLEAR, DROP, CREATE, ADD, COPY, MOVE, LOAD
    prologue: str  # the PREFIX and BASE declarations in force, on one line
    text: str = ""  # the whole operation
    start: int = 0  # its position in the request
    delete: str = "{}"  # template
    insert: str = "{}"  # template, or the data of INSERT DATA
    where: str = "{}"  # group
    within: str = ""  # the graph of WITH
    using: str = ""  # USING clauses, rewritten as FROM clauses of a query
    silent: bool = False
    graphs: tuple[str, ...] = ()  # of CLEAR ... MOVE: an IRI, or DEFAULT, NAMED, ALL


class UnclearError(QueryError):
    """An operation cannot be split into its parts; the engine's parser may report why."""


def operations(sparql: str, prologue: str = "") -> Iterator[Operation]:
    """The operations of an update request, in order; `prologue` has declarations for all of them.

    Raises:
        QueryError: an operation is unknown.
        UnclearError: an operation cannot be split into parts.
    """
    for tokens, start, end in _split(sparql):
        cut = _after_prologue(tokens)
        prologue += "".join(f"{token.text} " for token in tokens[:cut])
        if tokens[cut:]:
            start = tokens[cut - 1].end if cut else start
            operation = _Parts(sparql, tokens[cut:]).operation(prologue)
            yield replace(operation, text=sparql[start:end], start=start)


def check_blank_labels(parts: Iterable[Operation]) -> None:
    """Raises QueryError if two INSERT DATA share a blank node label (SPARQL 1.1, section 19.6).

    The engine parses the operations one by one and does not notice.
    """
    used: set[str] = set()
    for part in parts:
        if part.verb == "INSERT DATA":
            labels = {token.text for token in tokens_of(part.insert) if token.kind == "blank"}
            if both := sorted(used & labels):
                raise QueryError(
                    f"update: two INSERT DATA operations use the blank node {both[0]}; "
                    "write them as one, or rename it"
                )
            used |= labels


def variables_as_iris(template: str) -> str:
    """The template with an IRI under `VARIABLE` for each variable, so that it parses as data."""

    def iri_of(token: Token) -> str | None:
        variable = token.kind in ("variable", "parameter")
        return f" <{VARIABLE}{token.text[1:]}> " if variable else None

    return replace_tokens(template, iri_of)


def _split(sparql: str) -> Iterator[tuple[list[Token], int, int]]:
    """The tokens, start and end of each operation; semicolons separate operations."""
    depth, start, operation = 0, 0, list[Token]()
    for token in tokens_of(sparql):
        depth += _step(token)
        if token.text == ";" and token.kind == "mark" and depth == 0:
            yield operation, start, token.start
            start, operation = token.end, []
        else:
            operation.append(token)
    yield operation, start, len(sparql)


def _step(token: Token) -> int:
    """The change of the depth of braces by a token."""
    return {"{": 1, "}": -1}.get(token.text, 0) if token.kind == "mark" else 0


def _after_prologue(tokens: list[Token]) -> int:
    at = 0
    while at < len(tokens) and tokens[at].keyword in ("PREFIX", "BASE"):
        at += 3 if tokens[at].keyword == "PREFIX" else 2
    return at


class _Parts:
    """Recursive descent over the tokens of one operation."""

    def __init__(self, sparql: str, tokens: list[Token]) -> None:
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
            verbs = ("INSERT", "DELETE", "WITH", *_ONE_GRAPH, *_TWO_GRAPHS)
            given = self._tokens[0].text
            near = did_you_mean(given, verbs) or f"; there are: {', '.join(verbs)}"
            raise QueryError(f"{given} is no operation of an update{near}")
        plain = [t for t in self._tokens[1:] if t.keyword not in ("SILENT", "GRAPH", "TO", "INTO")]
        graphs = tuple(t.keyword or t.text for t in plain)
        if len(graphs) != (2 if words[0] in _TWO_GRAPHS else 1):
            raise self._unclear()
        return Operation(words[0], prologue, silent="SILENT" in words, graphs=graphs)

    def _take(self) -> Token:
        if self._at >= len(self._tokens):
            raise self._unclear()
        self._at += 1
        return self._tokens[self._at - 1]

    def _group(self) -> str:
        start = self._take()
        depth, token = 1, start
        while depth:
            token = self._take()
            depth += _step(token)
        return self._sparql[start.start : token.end]

    def _unclear(self) -> UnclearError:
        return UnclearError(
            f"the update's {self._tokens[0].text} cannot be parsed; "
            "put spaces around < and > where they compare"
        )


def with_graphs(sparql: str, default: Sequence[str], named: Sequence[str]) -> str:
    """The update with USING clauses for those graphs; unchanged without any graph.

    Raises:
        QueryError: the update has WITH or USING itself, or a graph is no absolute IRI.
    """
    if not default and not named:
        return sparql
    if has_word(sparql, "using") or has_word(sparql, "with"):
        raise QueryError("the update has USING or WITH itself; leave out the using-graph-uri")
    clauses = "".join(f"USING {_node(iri)} " for iri in default)
    clauses += "".join(f"USING NAMED {_node(iri)} " for iri in named)
    pieces, done = [], 0
    for start, end, text in _changes(sparql, clauses):
        pieces += [sparql[done:start], text]
        done = end
    return "".join([*pieces, sparql[done:]])


def _changes(sparql: str, clauses: str) -> Iterator[tuple[int, int, str]]:
    words = list(_outer_words(sparql))
    for before, word in zip([None, *words], words, strict=False):
        if word.keyword != "WHERE":
            continue
        if before is not None and before.keyword == "DELETE":
            # DELETE WHERE takes no USING: its pattern is its template as well
            closing = (w.end for w in words if w.start > word.start and w.text == "}")
            pattern = sparql[word.end : next(closing, word.end)]
            yield word.start, word.end, f"{pattern.strip()} {clauses}WHERE"
        else:
            yield word.start, word.start, clauses


def _outer_words(sparql: str) -> Iterator[Token]:
    """The keywords, braces and semicolons outside of all braces."""
    depth = 0
    for token in tokens_of(sparql):
        depth -= token.text == "}"
        if depth == 0 and (token.kind == "word" or token.text in ("{", "}", ";")):
            yield token
        depth += token.text == "{"


def _node(iri: str) -> NamedNode:
    try:
        return NamedNode(iri)
    except ValueError as error:
        raise QueryError(f"a graph needs an absolute IRI, got {iri[:100]!r}") from error
