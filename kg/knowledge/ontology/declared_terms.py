"""Declared terms of the vocabulary and an ontology, and near spellings of undeclared ones."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import NamedNode

from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.lexer import tokens_of

_PREFIX = "here:"


def declared_terms(engine: QuadStore) -> set[str]:
    """IRIs in ``here:`` that the vocabulary module or the ontology in the store declares."""
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, None, v.ONTOLOGY_GRAPH)
    declared = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return {iri for iri in v.TERMS | declared if iri.startswith(v.HERE)} | {v.HERE}


def known_terms(engine: QuadStore) -> set[str]:
    """IRIs that a query may use: the vocabulary's, and those that the ontology declares."""
    return declared_terms(engine) | v.TERMS


def undeclared_terms(sparql: str, engine: QuadStore) -> tuple[str, ...]:
    """A message for each undeclared ``here:`` term of a query.

    Without it, a misspelt class matches nothing and causes no error.
    """
    used = dict.fromkeys(iri for token in tokens_of(sparql) if (iri := _iri(token.text)))
    if not used:
        return ()
    declared = declared_terms(engine)
    return tuple(undeclared(iri, declared) for iri in used if iri not in declared)


def undeclared(iri: str, declared: set[str]) -> str:
    """The message for an undeclared ``here:`` term, with the closest declared one."""
    return f"no ontology declares {v.curie(iri)}{like_declared(iri, declared)}"


def like_declared(iri: str, declared: Iterable[str]) -> str:
    """A clause that names the term with the closest local name, whatever its namespace is.

    Terms are the `declared` ones, and the vocabulary's. The clause is empty without a close name.
    """
    known = sorted({*declared, *v.TERMS} - {iri}, key=lambda term: not term.startswith(v.HERE))
    names = {v.local_name(term): v.curie(term) for term in reversed(known)}
    return did_you_mean(v.local_name(iri), names)


def _iri(text: str) -> str:
    """The IRI of a token that is a ``here:`` term, prefixed or not; empty for other tokens."""
    if text.startswith(_PREFIX):
        return v.HERE + text.removeprefix(_PREFIX)
    return text[1:-1] if text.startswith(f"<{v.HERE}") else ""
