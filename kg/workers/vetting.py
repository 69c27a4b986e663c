"""What an untrusted query may not even try, decided before it is parsed.

Oxigraph evaluates SERVICE whenever it meets one, and its parser recurses: a few hundred nested
brackets overflow the stack. This runs inside the worker, so a text made to be slow to vet costs its
own time limit and nobody else's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping

from kg.errors import QueryError, QueryRefusedError
from kg.sparql_text import tokens, without_escapes

MAX_LENGTH = 200_000  # characters; a VALUES of 2,000 IRIs is half of it
MAX_DEPTH = 100  # brackets; the parser's stack ends between 400 and 2,000

_GAP = r"(?:\s|\#[^\n\r]*[\n\r])*+"
# overlapping (a lookahead) and over the raw text, strings and comments included: whatever a string
# or comment swallows in our reading may be code in the engine's; a false alarm costs a rewording
_SERVICE = re.compile(
    rf"(?=service{_GAP}(?:silent{_GAP})?(?P<endpoint><[^>]*>|[?$]\w+|[\w.-]*:[^\s{{]*){_GAP}\{{)",
    re.IGNORECASE,
)
_UPDATES = frozenset(
    ("insert", "delete", "load", "clear", "drop", "create", "add", "move", "copy", "with")
)


def refuse_surrogates(text: str) -> None:
    """Raises QueryError where a text is no Unicode."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise QueryError(
            f"the query is no Unicode text: character {error.start} is half of a surrogate pair"
        ) from error


def refuse_length(sparql: str, limit: int = MAX_LENGTH) -> None:
    """Raises QueryRefusedError where the text is too long to look at."""
    if len(sparql) > limit:
        raise QueryRefusedError(
            f"a query may have {limit:,} characters, got {len(sparql):,}; split it"
        )


def vet(
    sparql: str,
    *,
    is_graph: Callable[[str], bool],
    prefixes: Mapping[str, str] | None = None,
    services: Collection[str] = (),
    max_depth: int = MAX_DEPTH,
) -> None:
    """Raises QueryRefusedError where the text writes, reaches outside of the map, or nests deeply.

    `is_graph` says whether an IRI names a graph of the map, `prefixes` are those declared for
    every query, `services` the IRIs that SERVICE may name.
    """
    decoded = without_escapes(sparql)
    _refuse_update(decoded)
    _refuse_depth(decoded, max_depth)
    for text in {sparql, decoded}:
        _refuse_services(text, services)
    for iri in _dataset_clauses(decoded, prefixes or {}):
        refuse_other_graph(iri, is_graph)


def refuse_other_graph(iri: str, is_graph: Callable[[str], bool]) -> None:
    """Raises QueryRefusedError where the IRI names no graph of the map."""
    if not is_graph(iri):
        raise QueryRefusedError(
            f"FROM {iri!r} is refused: no graph of this map is called so, and nothing is fetched; "
            "leave FROM out to ask all graphs"
        )


def reads_chosen_graphs(sparql: str) -> bool:
    """Whether the text has a FROM clause, so that its default graph is not the union."""
    return any((m["word"] or "").lower() == "from" for m in tokens(without_escapes(sparql)))


def _refuse_update(sparql: str) -> None:
    words = (m["word"].lower() for m in tokens(sparql) if m["word"])
    first = next((word for word in words if word not in ("prefix", "base")), "")
    if first in _UPDATES:
        raise QueryRefusedError(
            f"{first.upper()} is an update: a query only reads (SELECT, ASK, CONSTRUCT, DESCRIBE)"
        )


def _refuse_depth(sparql: str, limit: int) -> None:
    depth = 0
    for match in tokens(sparql):
        depth += 1 if (bracket := match["bracket"] or "") and bracket in "({[" else 0
        depth -= 1 if bracket and bracket in ")}]" else 0
        if depth > limit:
            raise QueryRefusedError(f"brackets may nest {limit} deep, here they nest deeper")


def _refuse_services(sparql: str, allowed: Collection[str]) -> None:
    endpoints = [match["endpoint"] for match in _SERVICE.finditer(sparql)]
    words = sum((m["word"] or "").lower() == "service" for m in tokens(sparql))
    known = words <= len(endpoints) and all(endpoint[1:-1] in allowed for endpoint in endpoints)
    if not known:
        there = f"; allowed are: {', '.join(sorted(allowed))}" if allowed else ""
        raise QueryRefusedError(f"SERVICE is refused: a query reads this map alone{there}")


def _dataset_clauses(sparql: str, prefixes: Mapping[str, str]) -> Iterator[str]:
    """The IRIs behind FROM and FROM NAMED; what cannot be resolved comes as it is written."""
    declared = dict(prefixes)
    before, last = "", ""
    for match in tokens(sparql):
        text = match[0]
        if text.startswith("#"):
            continue
        if last == "from" or (before, last) == ("from", "named"):
            if match["iri"] or match["name"]:
                yield _resolved(text, declared)
        elif before == "prefix" and match["iri"]:
            declared[last.removesuffix(":")] = text[1:-1]
        before, last = last, text.lower() if match["word"] else text


def _resolved(term: str, declared: Mapping[str, str]) -> str:
    if term.startswith("<"):
        return term[1:-1]
    prefix, _, local = term.partition(":")
    return declared[prefix] + local if prefix in declared else term
