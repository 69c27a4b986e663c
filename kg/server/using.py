"""The graphs a protocol request names for an update (SPARQL 1.1 Protocol, section 2.2.3).

They are written into the update as USING clauses, token by token: what stands in strings, comments
and IRIs is left alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pyoxigraph import NamedNode

from kg.server.problems import Problem
from kg.sparql_text import has_word

_TOKEN = re.compile(
    r"""(?P<skip> \#[^\n\r]*
        | <(?:[^<>"{}|^`\\\x00-\x20] | \\u[0-9a-fA-F]{4} | \\U[0-9a-fA-F]{8})*>
        | \"\"\"(?:[^"\\] | \\. | "(?!""))*\"\"\"  | '''(?:[^'\\] | \\. | '(?!''))*'''
        | "(?:[^"\\\n\r] | \\.)*"  | '(?:[^'\\\n\r] | \\.)*'
        | [?$]\w+ | @\w+ | (?:\w[\w.-]*)?:(?:[\w:%.-] | \\.)* )
      | (?P<word> \w+) | (?P<mark> [{};]) | (?P<space> \s+) | (?P<other> .)""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class _Word:
    """A keyword, brace or semicolon outside of all braces, and where it stands."""

    text: str
    start: int
    end: int


def with_graphs(sparql: str, default: Sequence[str], named: Sequence[str]) -> str:
    """The update with its WHERE clauses read over those graphs; unchanged where none is named.

    Raises Problem 400 where the update says itself which graphs it reads (WITH, USING), or a graph
    is no absolute IRI.
    """
    if not default and not named:
        return sparql
    if has_word(sparql, "using") or has_word(sparql, "with"):
        raise Problem(400, "the update has USING or WITH itself; leave out the using-graph-uri")
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
        if word.text != "where":
            continue
        if before is not None and before.text == "delete":
            # DELETE WHERE takes no USING: its pattern is its template as well
            pattern = sparql[word.end : _closing(words, word)]
            yield word.start, word.end, f"{pattern.strip()} {clauses}WHERE"
        else:
            yield word.start, word.start, clauses


def _closing(words: list[_Word], where: _Word) -> int:
    return next((w.end for w in words if w.start > where.start and w.text == "}"), where.end)


def _outer_words(sparql: str) -> Iterator[_Word]:
    depth = 0
    for match in _TOKEN.finditer(sparql):
        text = (match["word"] or match["mark"] or "").lower()
        depth -= text == "}"
        if text and depth == 0:
            yield _Word(text, match.start(), match.end())
        depth += text == "{"


def _node(iri: str) -> NamedNode:
    try:
        return NamedNode(iri)
    except ValueError as error:
        raise Problem(400, f"a graph needs an absolute IRI, got {iri[:100]!r}") from error
