"""Media types and serialisation of documents of triples."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from pyoxigraph import Quad, RdfFormat, Triple
from starlette.requests import Request

from kg.export.serialization import serialised
from kg.rdf.jsonld import to_jsonld
from kg.serving.server.http.bodies import RequestParameters
from kg.serving.server.http.problems import Problem

HTML: Final = "text/html"
EVENTS: Final = "text/event-stream"
SOLUTIONS: Final = "application/sparql-results+json"

#: media type -> format, for documents of triples; the first is the default
GRAPH_FORMATS: Final[dict[str, RdfFormat]] = {
    "text/turtle": RdfFormat.TURTLE,
    "application/ld+json": RdfFormat.JSON_LD,
    "application/n-triples": RdfFormat.N_TRIPLES,
    "application/rdf+xml": RdfFormat.RDF_XML,
    "text/n3": RdfFormat.N3,
    "application/trig": RdfFormat.TRIG,
    "application/n-quads": RdfFormat.N_QUADS,
}


#: names of formats in the parameter `format` (or `output`), as in other SPARQL endpoints
_NAMES: Final[dict[str, tuple[str, ...]]] = {
    "json": (SOLUTIONS, "application/ld+json;q=0.9", "application/json;q=0.8"),
    "xml": ("application/sparql-results+xml", "application/rdf+xml"),
    "csv": ("text/csv",),
    "tsv": ("text/tab-separated-values",),
    "html": (HTML,),
    "turtle": ("text/turtle",),
    "ntriples": ("application/n-triples",),
    "jsonld": ("application/ld+json",),
    "rdfxml": ("application/rdf+xml",),
    "n3": ("text/n3",),
    "trig": ("application/trig",),
    "nquads": ("application/n-quads",),
}
_SHORT: Final = {"ttl": "turtle", "nt": "ntriples", "rdf": "rdfxml", "nq": "nquads"}


def accept_of(request: Request, given: RequestParameters) -> str | None:
    """The media types that a client accepts: its parameter `format`, else its header Accept.

    A format is a name (csv, json, ttl, ...) or a media type. Raises Problem 400 for another.
    """
    name = given.one("format") or given.one("output")
    if not name:
        return request.headers.get("accept")
    key = re.sub(r"[-_./+ ]", "", name.lower())
    types = _NAMES.get(_SHORT.get(key, key))
    if types is not None:
        return ", ".join(types)
    if "/" in name:
        return name.replace(" ", "+")  # an unescaped +
    names = ", ".join([*_NAMES, *_SHORT])
    raise Problem(400, f"no format {name[:40]!r}; there are: {names}, or a media type")


def document(triples: Iterable[Triple], media_type: str, prefixes: dict[str, str]) -> bytes:
    """Triples as a document in one of `GRAPH_FORMATS`; JSON-LD with its context."""
    form = GRAPH_FORMATS[media_type]
    if form == RdfFormat.JSON_LD:
        return to_jsonld(triples, prefixes).encode()
    statements: Iterable[Triple] | Iterable[Quad] = triples
    if form in (RdfFormat.TRIG, RdfFormat.N_QUADS):
        statements = [Quad(t.subject, t.predicate, t.object) for t in triples]
    return serialised(statements, form, prefixes).encode()
