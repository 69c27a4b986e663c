"""Declared ``here:`` terms of the vocabulary and an ontology; undeclared ones in queries."""

from __future__ import annotations

import re

from pyoxigraph import NamedNode

from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.lexer import tokens_of

_PREFIX = "here:"


def declared_terms(engine: QuadStore) -> set[str]:
    """IRIs in ``here:`` that the vocabulary module or the ontology in the store declares."""
    vocabulary = {value for value in vars(v).values() if isinstance(value, str)}
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, None, v.ONTOLOGY_GRAPH)
    declared = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return {iri for iri in vocabulary | declared if iri.startswith(v.HERE)} | {v.HERE}


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
    """The message for an undeclared ``here:`` term, with declared terms of a close spelling."""
    names = {_short(known).lower(): _short(known) for known in declared if known != v.HERE}
    close = did_you_mean(_short(iri).lower(), names)
    spelt = re.sub(r"here:[\w-]+", lambda match: names[match[0]], close)
    return f"no ontology declares {_short(iri)}{spelt}"


def _short(iri: str) -> str:
    return _PREFIX + iri.removeprefix(v.HERE)


def _iri(text: str) -> str:
    """The IRI of a token that is a ``here:`` term, prefixed or not; empty for other tokens."""
    if text.startswith(_PREFIX):
        return v.HERE + text.removeprefix(_PREFIX)
    return text[1:-1] if text.startswith(f"<{v.HERE}") else ""
