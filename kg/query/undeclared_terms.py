"""Terms of a query that no ontology declares: a misspelt class matches nothing, silently."""

from __future__ import annotations

from kg import vocabulary as v
from kg.ontology.declared_terms import declared_terms, undeclared
from kg.rdf.quad_store import QuadStore
from kg.sparql.lexer import tokens_of

_PREFIX = "here:"


def undeclared_terms(sparql: str, engine: QuadStore) -> tuple[str, ...]:
    """A line for each ``here:`` term of a query that neither ontology nor vocabulary has."""
    used = dict.fromkeys(iri for token in tokens_of(sparql) if (iri := _iri(token.text)))
    if not used:
        return ()
    declared = declared_terms(engine)
    return tuple(undeclared(iri, declared) for iri in used if iri not in declared)


def _iri(text: str) -> str:
    """The IRI of a ``here:`` term, written with its prefix or as an IRI; else empty."""
    if text.startswith(_PREFIX):
        return v.HERE + text.removeprefix(_PREFIX)
    return text[1:-1] if text.startswith(f"<{v.HERE}") else ""
