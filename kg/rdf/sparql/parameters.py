"""Parameters (`$name`) of a query text, and what else its tokens reveal before it is parsed.

The engine's own substitution reaches projected variables of SELECT alone (a parameter inside FILTER
or a subquery is refused), so terms are substituted here: token by token, outside of strings,
comments and IRIs, each serialised by the engine. Text of a user is never pasted.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from pyoxigraph import Literal, NamedNode

from kg.rdf.sparql.lexer import Token, keywords_of, replace_tokens, tokens_of

Term = NamedNode | Literal

_RELATIVE = re.compile(r"<(?![A-Za-z][A-Za-z0-9+.-]*:)[^<>\"{}|^`\\\x00-\x20]*>")


def parameters_in(sparql: str) -> frozenset[str]:
    """Names of the `$parameters` of a query text."""
    return frozenset(token.text[1:] for token in tokens_of(sparql) if token.kind == "parameter")


def variables_in(sparql: str) -> frozenset[str]:
    """Names of the `?variables` of a query text."""
    return frozenset(token.text[1:] for token in tokens_of(sparql) if token.kind == "variable")


def substitute(sparql: str, terms: Mapping[str, Term]) -> str:
    """The text with each `$name` of `terms` replaced by its RDF term, on the same line."""

    def term_of(token: Token) -> str | None:
        term = terms.get(token.text[1:]) if token.kind == "parameter" else None
        return None if term is None else str(term)

    return replace_tokens(sparql, term_of)


def insert_into_pattern(sparql: str, clause: str) -> str:
    """The text with `clause` at the start of its outermost pattern, on the same line."""
    start = next((token.end for token in tokens_of(sparql) if token.text == "{"), 0)
    return sparql[:start] + clause + sparql[start:]


def has_word(sparql: str, word: str) -> bool:
    """Whether a keyword occurs outside of strings, comments, IRIs and names."""
    keyword = word.upper()
    return keyword in sparql.upper() and keyword in keywords_of(sparql)


def has_relative(sparql: str) -> bool:
    """Whether the text may have relative IRIs, so that it needs a base."""
    return _RELATIVE.search(sparql) is not None
