"""Lexer of SPARQL 1.1 (section 19.8): the tokens of a query or update, with their positions.

The lexer accepts any text: a character that begins no token is a token of kind ``other``. It is no
security boundary. The engine's parser needs no white space between tokens and tries alternatives,
so no lexer knows for certain which words are keywords; `kg.serving.workers.isolation`
blocks the network in the kernel.

The engine substitutes only projected variables of SELECT, not parameters inside FILTER or a
subquery. So `substitute` replaces parameters by RDF terms that the engine serialised, outside of
strings, comments and IRIs. It never pastes text of a user.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, lru_cache
from itertools import accumulate
from typing import Final, NamedTuple

from pyoxigraph import Literal, NamedNode

_NON_ASCII_BASE: Final = (
    "\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c\u200d"
    "\u2070-\u218f\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_NON_ASCII_MORE: Final = "\u00b7\u0300-\u036f\u203f\u2040"
# after any other escape in a triple-quoted string, the engine reads two strings
_ESCAPE: Final = r"\\[tbnrf\\\"'uU]"
_CODEPOINT: Final = re.compile(r"\\u([0-9a-fA-F]{4})|\\U([0-9a-fA-F]{8})")


@cache
def _pattern(base: str, more: str) -> re.Pattern[str]:
    """Pattern of all tokens; `base` begins names (PN_CHARS_BASE), `more` continues them."""
    name_end = f"[{base}_{more}-]"
    local = rf"(?:[{base}_:{more}-]|%[0-9A-Fa-f]{{2}}|\\[_~.!$&'()*+,;=/?\#@%-])"
    variable = f"[{base}_0-9][{base}_{more}]*"
    return re.compile(
        rf"""
          (?P<space> \s+ )
        | (?P<comment> \#[^\n\r]* )
        | (?P<iri> <(?:[^<>"{{}}|^`\\\x00-\x20] | \\u[0-9a-fA-F]{{4}} | \\U[0-9a-fA-F]{{8}})*> )
        | (?P<string> \"\"\"(?:[^"\\] | {_ESCAPE} | "(?!""))*\"\"\"
            | \'\'\'(?:[^'\\] | {_ESCAPE} | '(?!''))*\'\'\'
            | "(?:[^"\\\n\r] | {_ESCAPE})*" | '(?:[^'\\\n\r] | {_ESCAPE})*' )
        | \?(?P<variable> {variable} )
        | \$(?P<parameter> {variable} )
        | (?P<blank> _:(?:[{base}_0-9](?:[{base}_{more}.-]*{name_end})?)? )
        | (?P<name> (?:[{base}](?:[{base}_{more}.-]*{name_end})?)?:(?:{local}(?:\.*{local})*)? )
        | (?P<language> @[A-Za-z]+(?:-[A-Za-z0-9]+)* )
        | (?P<word> \w+ )
        | (?P<mark> [][(){{}};] )
        | (?P<other> \\. | . )
        """,
        re.VERBOSE | re.DOTALL,
    )


_SHORT: Final = 10_000  # characters of a text whose tokens are kept: all shipped queries


class Token(NamedTuple):
    """A token: its kind (a group of the pattern), its text and its position."""

    kind: str
    text: str
    start: int
    end: int

    @property
    def keyword(self) -> str:
        """The word in upper case, since keywords ignore case; empty for other kinds."""
        return self.text.upper() if self.kind == "word" else ""


def tokens_of(sparql: str) -> Iterable[Token]:
    """The tokens of a text, without white space and comments; those of short texts are kept."""
    return _kept(sparql) if len(sparql) <= _SHORT else _lexed(sparql)


@lru_cache(maxsize=64)
def _kept(sparql: str) -> tuple[Token, ...]:
    return tuple(_lexed(sparql))


def _lexed(sparql: str) -> Iterator[Token]:
    # the full character classes take longer to compile than most commands take to start
    ascii_only = sparql.isascii()
    base = "A-Za-z" + ("" if ascii_only else _NON_ASCII_BASE)
    more = "0-9" + ("" if ascii_only else _NON_ASCII_MORE)
    for match in _pattern(base, more).finditer(sparql):
        kind = str(match.lastgroup)
        if kind not in ("space", "comment"):
            yield Token(kind, match[0], match.start(), match.end())


def keywords_of(sparql: str) -> Iterator[str]:
    """The words outside of strings, comments, IRIs and names, in upper case."""
    return (token.keyword for token in tokens_of(sparql) if token.kind == "word")


def replace_tokens(sparql: str, replacement: Callable[[Token], str | None]) -> str:
    """The text with tokens replaced; `replacement` returns None for a token to keep."""
    pieces, done = [], 0
    for token in tokens_of(sparql):
        text = replacement(token)
        if text is not None:
            pieces += [sparql[done : token.start], text]
            done = token.end
    return "".join([*pieces, sparql[done:]])


def decode_escapes(sparql: str) -> str:
    """The text with its codepoint escapes (SPARQL 1.1, section 19.2) decoded."""
    return _CODEPOINT.sub(lambda m: chr(min(int(m[1] or m[2], 16), 0x10FFFF)), sparql)


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


def insert_into_pattern(sparql: str, first: str, last: str = "") -> str:
    """The text with clauses at the start and the end of its outermost pattern; no new lines."""
    braces = [token for token in tokens_of(sparql) if token.text in ("{", "}")]
    depths = accumulate(1 if token.text == "{" else -1 for token in braces)
    start = next((token.end for token in braces), 0)
    end = next((b.start for b, depth in zip(braces, depths, strict=True) if not depth), start)
    return sparql[:start] + first + sparql[start:end] + last + sparql[end:]


def has_word(sparql: str, word: str) -> bool:
    """Whether a keyword occurs outside of strings, comments, IRIs and names."""
    keyword = word.upper()
    return keyword in sparql.upper() and keyword in keywords_of(sparql)


def has_relative(sparql: str) -> bool:
    """Whether the text may have relative IRIs, which need a base."""
    return _RELATIVE.search(sparql) is not None
