"""Parameters (`$name`), variables, keywords and relative IRIs of a query text.

The engine substitutes only projected variables of SELECT, not parameters inside FILTER or a
subquery. So this module substitutes tokens by RDF terms that the engine serialised, outside of
strings, comments and IRIs. It never pastes text of a user.
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
    """The text with each `$name` replaced by its RDF term in `terms`, without new lines."""

    def term_of(token: Token) -> str | None:
        term = terms.get(token.text[1:]) if token.kind == "parameter" else None
        return None if term is None else str(term)

    return replace_tokens(sparql, term_of)


def insert_into_pattern(sparql: str, clause: str) -> str:
    """The text with `clause` at the start of its outermost pattern, without new lines."""
    start = next((token.end for token in tokens_of(sparql) if token.text == "{"), 0)
    return sparql[:start] + clause + sparql[start:]


def has_word(sparql: str, word: str) -> bool:
    """Whether a keyword occurs outside of strings, comments, IRIs and names."""
    keyword = word.upper()
    return keyword in sparql.upper() and keyword in keywords_of(sparql)


def has_relative(sparql: str) -> bool:
    """Whether the text may have relative IRIs, which need a base."""
    return _RELATIVE.search(sparql) is not None
