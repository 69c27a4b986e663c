"""Lexer of SPARQL 1.1 (section 19.8): the tokens of a query or update, with their positions.

It accepts any text: a character that begins no token is a token of kind ``other``. The engine's
parser needs no white space between tokens, and tries alternatives, so that no lexer can determine
with certainty which words it reads as keywords: `kg.serving.workers.network_isolation` denies
queries the network through the kernel, this module does not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Final, NamedTuple

_NON_ASCII_BASE: Final = (
    "\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c\u200d"
    "\u2070-\u218f\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_NON_ASCII_MORE: Final = "\u00b7\u0300-\u036f\u203f\u2040"
# with any other escape in a text of three quotes, the engine reads an empty string and a new one
_ESCAPE: Final = r"\\[tbnrf\\\"'uU]"
_CODEPOINT: Final = re.compile(r"\\u([0-9a-fA-F]{4})|\\U([0-9a-fA-F]{8})")


@cache
def _pattern(base: str, more: str) -> re.Pattern[str]:
    """The tokens, with characters that begin names (PN_CHARS_BASE) and that continue them."""
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


def _lexer(sparql: str) -> re.Pattern[str]:
    # compiling the character classes beyond ASCII takes longer than most commands take to start
    if sparql.isascii():
        return _pattern("A-Za-z", "0-9")
    return _pattern(f"A-Za-z{_NON_ASCII_BASE}", f"0-9{_NON_ASCII_MORE}")


class Token(NamedTuple):
    """A token: its kind (a group of the lexer), and its position in the text."""

    kind: str
    text: str
    start: int
    end: int

    @property
    def keyword(self) -> str:
        """The word in upper case, as keywords are of any case; empty for other kinds."""
        return self.text.upper() if self.kind == "word" else ""


def tokens_of(sparql: str) -> Iterator[Token]:
    """The tokens of a text, without white space and comments."""
    for match in _lexer(sparql).finditer(sparql):
        kind = str(match.lastgroup)
        if kind not in ("space", "comment"):
            yield Token(kind, match[0], match.start(), match.end())


def keywords_of(sparql: str) -> Iterator[str]:
    """The words outside of strings, comments, IRIs and names, in upper case."""
    return (token.keyword for token in tokens_of(sparql) if token.kind == "word")


def replace_tokens(sparql: str, replacement: Callable[[Token], str | None]) -> str:
    """The text with each token replaced for which `replacement` returns a text."""
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
