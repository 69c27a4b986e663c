"""The words of a SPARQL query, for a parser: what is none is not understood."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

# with any other escape in what three quotes begin, the engine reads them as '' and one that begins
_ESCAPED = r"\\[tbnrf\\\"']"
_LOCAL = r"(?:[\w:-]|%[0-9A-Fa-f]{2})"
_TOKEN: Final = re.compile(
    rf"""
      (?P<gap> \s+ | \#[^\n\r]* )
    | (?P<iri> <[^<>"{{}}|^`\\\x00-\x20]*> )
    | (?P<literal> \"\"\"(?:[^"\\] | {_ESCAPED} | "(?!""))*\"\"\"
        | '''(?:[^'\\] | {_ESCAPED} | '(?!''))*'''
        | "(?:[^"\\\n\r] | {_ESCAPED})*" | '(?:[^'\\\n\r] | {_ESCAPED})*' )
    | (?P<variable> [?$]\w+ )
    | (?P<blank> _:\w(?:[\w.-]*[\w-])? )
    | (?P<name> (?:[^\W\d_][\w.-]*)?:(?:(?!-){_LOCAL}(?:\.*{_LOCAL})*)? )
    | (?P<number> \d+\.\d*[eE][+-]?\d+ | (?:\d+(?:\.\d+)? | \.\d+)(?:[eE][+-]?\d+)? )
    | (?P<language> @[A-Za-z]+(?:-[A-Za-z0-9]+)* )
    | (?P<word> [A-Za-z_]\w* )
    | (?P<mark> \^\^ | && | \|\| | [<>!]=? | [][{{}}().,;|/^*?+=-] )
    """,
    re.VERBOSE | re.DOTALL,
)


class UnreadError(Exception):
    """What stands here is not understood."""


def words_of(sparql: str) -> Iterator[tuple[str, str]]:
    """Kind and text of each token; keywords in lower case, as their case does not matter."""
    at = 0
    while at < len(sparql):
        match = _TOKEN.match(sparql, at)
        if match is None:
            raise UnreadError(sparql[at : at + 20])
        at, kind = match.end(), str(match.lastgroup)
        if kind == "word" and match[0] != "a":
            yield kind, match[0].lower() if match[0] != "A" else "A"
        elif kind != "gap":
            yield kind, match[0]
