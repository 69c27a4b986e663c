"""What must be known of a SPARQL text before the engine sees it: its `$parameters`, and its reach.

The engine's own substitution reaches projected variables of SELECT alone (a parameter inside FILTER
or a subquery is refused), so terms are put in here: token by token, outside of strings, comments
and IRIs, each written by the engine's own serialiser. Text of a user is never pasted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal, NamedNode

from kg.errors import QueryError

Term = NamedNode | Literal

_ESCAPED = r"\\[tbnrf\\\"'uU]"  # where another stands, the engine takes no long string to begin
STRING: Final = rf"""
    \"\"\"(?:[^"\\] | {_ESCAPED} | "(?!""))*\"\"\" | \'\'\'(?:[^'\\] | {_ESCAPED} | '(?!''))*\'\'\'
    | "(?:[^"\\\n\r] | {_ESCAPED})*" | '(?:[^'\\\n\r] | {_ESCAPED})*'
"""
_TOKEN = re.compile(
    rf"""
      (?P<skip> \\.
        | \#[^\n\r]*
        | (?P<iri> <(?:[^<>"{{}}|^`\\\x00-\x20] | \\u[0-9a-fA-F]{{4}} | \\U[0-9a-fA-F]{{8}})*> )
        | {STRING}
        | \?\w+ | (?P<name> (?:\w[\w.-]*)?:(?:[\w:%.-] | \\.)* ) )
    | \$(?P<parameter>\w+)
    | (?P<word>\w+)
    | (?P<bracket>[(){{}}\[\]])
    """,
    re.VERBOSE | re.DOTALL,
)
_GAP = r"(?:\s|\#[^\n\r]*[\n\r])*"
# read over the raw text, strings and comments included: a false alarm costs a rewording, a miss
# would let a question reach out to the network
_SERVICE = re.compile(
    rf"service{_GAP}(?:silent{_GAP})?(?:<[^>]*>|[?$]\w+|[\w.-]*:[^\s{{]*){_GAP}\{{", re.IGNORECASE
)
_ESCAPE = re.compile(r"\\u([0-9a-fA-F]{4})|\\U([0-9a-fA-F]{8})")
_RELATIVE = re.compile(r"<(?![A-Za-z][A-Za-z0-9+.-]*:)[^<>\"{}|^`\\\x00-\x20]*>")
_UPDATES = frozenset(
    "insert delete load clear drop create add move copy with".split()  # noqa: SIM905
)


def tokens(sparql: str) -> Iterator[re.Match[str]]:
    """The tokens: groups `word`, `iri`, `name` (prefixed), `parameter`, `bracket`, else `skip`."""
    return _TOKEN.finditer(sparql)


def without_escapes(sparql: str) -> str:
    """The text with its codepoint escapes (SPARQL 1.1, section 19.2) written out."""
    return _ESCAPE.sub(lambda m: chr(min(int(m[1] or m[2], 16), 0x10FFFF)), sparql)


def parameters_in(sparql: str) -> frozenset[str]:
    """Names of the `$parameters` of a query text."""
    return frozenset(m["parameter"] for m in _TOKEN.finditer(sparql) if m["parameter"])


def put_in(sparql: str, terms: Mapping[str, Term]) -> str:
    """The text with each `$name` of `terms` written as its RDF term, on the same line."""

    def written(match: re.Match[str]) -> str:
        term = terms.get(match["parameter"] or "")
        return match[0] if term is None else str(term)

    return _TOKEN.sub(written, sparql)


def after_where(sparql: str, clause: str) -> str:
    """The text with `clause` at the start of its outermost pattern, on the same line."""
    opening = (m.end() for m in _TOKEN.finditer(sparql) if m["bracket"] == "{")
    start = next(opening, 0)
    return sparql[:start] + clause + sparql[start:]


def has_word(sparql: str, word: str) -> bool:
    """Whether a keyword occurs outside of strings, comments, IRIs and names."""
    return any((m["word"] or "").lower() == word for m in _TOKEN.finditer(sparql))


def has_relative(sparql: str) -> bool:
    """Whether the text may have relative IRIs, so that it needs a base."""
    return _RELATIVE.search(sparql) is not None


@dataclass(frozen=True, slots=True)
class Tail:
    """What a query says of the order and number of its rows."""

    order: str  # the text of ORDER BY, or empty
    limit: int | None
    offset: bool  # whether it skips rows


def outermost(sparql: str) -> str:
    """The text, as long as it was, with what stands in braces blank and in other tokens masked."""
    masked = _TOKEN.sub(lambda m: m[0] if m["word"] or m["bracket"] else "_" * len(m[0]), sparql)
    depth, outer = 0, []
    for mark in masked:
        depth += (mark == "{") - (mark == "}")
        outer.append(mark if depth == 0 and mark != "}" else " ")
    return "".join(outer)


def tail_of(sparql: str) -> Tail:
    """The ORDER BY, LIMIT and OFFSET of the whole query; those of subqueries do not count."""
    flat = outermost(sparql)
    limit = re.search(r"\blimit\s+(\d+)", flat, re.IGNORECASE)
    offset = re.search(r"\boffset\s+0*[1-9]", flat, re.IGNORECASE)
    order = re.search(
        r"\border\s+by\b.*?(?=\b(?:limit|offset|values)\b|\Z)", flat, re.IGNORECASE | re.DOTALL
    )
    text = sparql[order.start() : order.end()].strip() if order else ""
    return Tail(text, int(limit[1]) if limit else None, offset is not None)


def refuse_reaching_out(sparql: str) -> None:
    """Raises QueryError where the text has a SERVICE clause, before anything is evaluated."""
    if _SERVICE.search(sparql) or _SERVICE.search(without_escapes(sparql)):
        raise QueryError(
            "SERVICE is refused: a question reads this map alone; "
            "export the map and join it with the other source there"
        )


def refuse_update(sparql: str) -> None:
    """Raises QueryError where the text is SPARQL Update."""
    words = (m["word"].lower() for m in _TOKEN.finditer(sparql) if m["word"])
    first = next((word for word in words if word not in ("prefix", "base")), "")
    if first in _UPDATES:
        raise QueryError(
            f"{first.upper()} is an update: a question only reads (SELECT, ASK, CONSTRUCT, "
            "DESCRIBE); write through SemanticMap.update"
        )
