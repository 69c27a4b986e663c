"""Terms of a query that no ontology declares: a misspelt class matches nothing, silently."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.errors import did_you_mean
from kg.sparql.lexer import tokens_of

_PREFIX = "here:"


def undeclared_terms(sparql: str, ontology: Iterable[Quad]) -> tuple[str, ...]:
    """A line for each ``here:`` term of a query that neither ontology nor vocabulary has."""
    used = dict.fromkeys(name for token in tokens_of(sparql) if (name := _name(token.text)))
    if not used:
        return ()
    types = {q.subject.value for q in ontology if isinstance(q.subject, NamedNode)}
    ours = {value for value in vars(v).values() if isinstance(value, str)}
    declared = {iri.removeprefix(v.HERE) for iri in types | ours if iri.startswith(v.HERE)}
    lower = {name.lower(): name for name in declared if name}
    lines = []
    for name in used:
        if name not in declared:
            close = did_you_mean(name, lower)
            for word in sorted(lower, key=len, reverse=True):
                close = close.replace(f" {word} ", f" here:{lower[word]} ")
                close = close.replace(f" {word}?", f" here:{lower[word]}?")
            lines.append(f"no ontology declares {_PREFIX}{name}{close}")
    return tuple(lines)


def _name(text: str) -> str:
    """The local name of a ``here:`` term, written with its prefix or as an IRI; else empty."""
    if text.startswith(_PREFIX):
        return text.removeprefix(_PREFIX)
    return text[1:-1].removeprefix(v.HERE) if text.startswith(f"<{v.HERE}") else ""
