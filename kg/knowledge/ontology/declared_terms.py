"""The ``here:`` terms that the vocabulary and a map's ontology declare, and those of a query."""

from __future__ import annotations

import re

from pyoxigraph import NamedNode

from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.quad_store import QuadStore
from kg.rdf.sparql.lexer import tokens_of

_PREFIX = "here:"


def declared_terms(engine: QuadStore) -> set[str]:
    """IRIs of the vocabulary's own terms, and of all that the ontology types; in ``here:``."""
    ours = {value for value in vars(v).values() if isinstance(value, str)}
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, None, v.ONTOLOGY_GRAPH)
    declared = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return {iri for iri in ours | declared if iri.startswith(v.HERE)} | {v.HERE}


def undeclared_terms(sparql: str, engine: QuadStore) -> tuple[str, ...]:
    """A line for each ``here:`` term of a query that is not declared.

    A misspelt class would match nothing, without an error.
    """
    used = dict.fromkeys(iri for token in tokens_of(sparql) if (iri := _iri(token.text)))
    if not used:
        return ()
    declared = declared_terms(engine)
    return tuple(undeclared(iri, declared) for iri in used if iri not in declared)


def undeclared(iri: str, declared: set[str]) -> str:
    """That no ontology declares a ``here:`` term, with declared ones of a close spelling."""
    names = {_short(known).lower(): _short(known) for known in declared if known != v.HERE}
    close = did_you_mean(_short(iri).lower(), names)
    spelt = re.sub(r"here:[\w-]+", lambda match: names[match[0]], close)
    return f"no ontology declares {_short(iri)}{spelt}"


def _short(iri: str) -> str:
    return _PREFIX + iri.removeprefix(v.HERE)


def _iri(text: str) -> str:
    """The IRI of a ``here:`` term, written with its prefix or as an IRI; else empty."""
    if text.startswith(_PREFIX):
        return v.HERE + text.removeprefix(_PREFIX)
    return text[1:-1] if text.startswith(f"<{v.HERE}") else ""
