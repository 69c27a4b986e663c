"""Vetting of queries and updates before parsing, with clear error messages.

Oxigraph evaluates every SERVICE clause, and its recursive parser overflows the stack on a few
hundred nested brackets. Vetting rejects both. It is no security boundary: the kernel blocks the
network (`kg.serving.workers.isolation.confinement`); on machines where it cannot,
`check_network_words` rejects every suspicious text. Untrusted queries are vetted inside the worker,
so that a text that is slow to vet uses up its own time limit only.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

from kg.model.errors import QueryError, QueryRefusedError
from kg.rdf.sparql.lexer import decode_escapes, keywords_of, tokens_of

MAX_LENGTH = 200_000  # characters; a VALUES of 2,000 IRIs is half of it
MAX_DEPTH = 100  # brackets; the parser's stack ends between 400 and 2,000

_GAP = r"(?:\s|\#[^\n\r]*[\n\r])*+"
# overlapping (a lookahead) and over the raw text with strings and comments, since the engine may
# read code in a part that the lexer reads as a string or a comment
_SERVICE = re.compile(
    rf"(?=service{_GAP}(?:silent{_GAP})?(?P<endpoint><[^>]*>|[?$]\w+|[^\s{{}}<>:]*:[^\s{{]*){_GAP}\{{)",
    re.IGNORECASE,
)
_LOAD = re.compile(rf"\bload{_GAP}(?:silent{_GAP})?(?:<[^>]*>|[\w.-]*:\w)", re.IGNORECASE)

_UPDATES = frozenset(
    ("INSERT", "DELETE", "LOAD", "CLEAR", "DROP", "CREATE", "ADD", "MOVE", "COPY", "WITH")
)


def check_unicode(text: str) -> None:
    """Raises QueryError if a text is not valid Unicode."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise QueryError(
            f"the query is no Unicode text: character {error.start} is half of a surrogate pair"
        ) from error


def check_length(sparql: str) -> None:
    """Raises QueryRefusedError if the text is too long."""
    if len(sparql) > MAX_LENGTH:
        raise QueryRefusedError(
            f"a query may have {MAX_LENGTH:,} characters, got {len(sparql):,}; split it"
        )


def vet(sparql: str, *, services: Collection[str] = ()) -> None:
    """Raises QueryRefusedError if the text writes, reads beyond the map, or nests too deeply.

    `services` are the IRIs that SERVICE may name. FROM only selects graphs of the map and needs no
    check.
    """
    check_no_update(sparql, hint="")
    check_nesting(sparql)
    for text in _readings(sparql):
        _check_services(text, services)


def reads_chosen_graphs(sparql: str) -> bool:
    """Whether the text has a FROM clause; its default graph is then not the union."""
    return any("FROM" in keywords_of(text) for text in _readings(sparql))


def check_no_service(sparql: str) -> None:
    """Raises QueryRefusedError if the text has a SERVICE clause."""
    if any(_SERVICE.search(text) for text in _readings(sparql)):
        raise QueryRefusedError(
            "SERVICE is refused: a query reads this map alone; "
            "export the map and join it with the other source there"
        )


def check_no_load(sparql: str) -> None:
    """Raises QueryRefusedError if the text has a LOAD operation."""
    if any(_LOAD.search(text) for text in _readings(sparql)):
        raise QueryRefusedError(
            "LOAD is refused: an update cannot read other sources; write INSERT DATA"
        )


def check_no_update(sparql: str, *, hint: str = "; write through SemanticMap.update") -> None:
    """Raises QueryRefusedError if the text is SPARQL Update."""
    for text in _readings(sparql):
        first = next((word for word in keywords_of(text) if word not in ("PREFIX", "BASE")), "")
        if first in _UPDATES:
            raise QueryRefusedError(
                f"{first} is an update: a query only reads (SELECT, ASK, CONSTRUCT, DESCRIBE){hint}"
            )


def check_nesting(sparql: str) -> None:
    """Raises QueryRefusedError if brackets nest deeper than MAX_DEPTH.

    At every door: far beyond it the parser ends the process.
    """
    for text in _readings(sparql):
        if sum(map(text.count, "({[")) <= MAX_DEPTH:
            continue  # most queries
        depth = 0
        for token in tokens_of(text):
            depth += (token.text in ("(", "{", "[")) - (token.text in (")", "}", "]"))
            if depth > MAX_DEPTH:
                raise QueryRefusedError(
                    f"brackets may nest {MAX_DEPTH} deep, here they nest deeper"
                )


def _readings(sparql: str) -> Iterable[str]:
    # the standard decodes escapes first; the engine only those in strings, IRIs and names
    return dict.fromkeys((sparql, decode_escapes(sparql)))


def has_allowed_service(sparql: str, allowed: Collection[str]) -> bool:
    """Whether the text has a SERVICE clause with one of the `allowed` endpoints."""
    return bool(allowed) and _allowed_clause(allowed).search(sparql) is not None


def check_network_words(sparql: str, allowed: Collection[str]) -> None:
    """Raises QueryRefusedError for the letters of SERVICE or LOAD anywhere in the text.

    For processes whose network the kernel cannot block. Strings, comments and names with these
    letters are rejected too, since only the engine's parser can tell them apart. Clauses with an
    `allowed` endpoint pass.
    """
    rest = _allowed_clause(allowed).sub("", sparql) if allowed else sparql
    for word in ("service", "load"):
        if word in decode_escapes(rest).lower():
            raise QueryRefusedError(
                f"the letters of {word.upper()} are refused anywhere in a query, since on this "
                "machine the kernel cannot deny queries the network; rewrite strings with them"
            )


def _allowed_clause(allowed: Collection[str]) -> re.Pattern[str]:
    iris = "|".join(re.escape(iri) for iri in allowed)
    return re.compile(rf"(?<!\w)service\s+(?:silent\s+)?<(?:{iris})>", re.IGNORECASE)


def _check_services(sparql: str, allowed: Collection[str]) -> None:
    endpoints = [match["endpoint"] for match in _SERVICE.finditer(sparql)]
    # also as a language tag, which may be a keyword to the engine
    words = sum(token.text.upper() in ("SERVICE", "@SERVICE") for token in tokens_of(sparql))
    if words > len(endpoints) or any(endpoint[1:-1] not in allowed for endpoint in endpoints):
        hint = f"; allowed are: {', '.join(sorted(allowed))}" if allowed else ""
        raise QueryRefusedError(f"SERVICE is refused: a query reads this map alone{hint}")
