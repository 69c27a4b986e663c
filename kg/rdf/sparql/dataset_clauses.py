"""Dataset of an update, named by a protocol request (SPARQL 1.1 Protocol, section 2.2.3).

The graphs are inserted into the update as USING clauses, outside of strings, comments and IRIs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pyoxigraph import NamedNode

from kg.model.errors import QueryError
from kg.rdf.sparql.lexer import Token, tokens_of
from kg.rdf.sparql.parameters import has_word


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
