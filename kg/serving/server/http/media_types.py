"""Media types of a request, and serialisation of documents of triples."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from pyoxigraph import Quad, RdfFormat, Triple
from starlette.requests import Request

from kg.export.serialization import serialised
from kg.rdf.standard_terms import to_jsonld
from kg.serving.server.http.bodies import RequestParameters, query_parameters
from kg.serving.server.http.problems import Problem
from kg.serving.workers.content_negotiation import GRAPH_TYPES, negotiate

HTML: Final = "text/html"
EVENTS: Final = "text/event-stream"
MAX_NAMES: Final = 8  # of formats in one request
MAX_LETTERS: Final = 400  # of one, which may be a list of media types
SOLUTIONS: Final = "application/sparql-results+json"

#: names of formats in the parameter `format` (or `output`), as in other SPARQL endpoints
_NAMES: Final[dict[str, tuple[str, ...]]] = {
    "json": (SOLUTIONS, "application/ld+json", "application/json"),
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
    """The media types that a client accepts: its parameters `format`, else its header Accept.

    A format is a name (csv, json, ttl, ...) or media types. The parameter may be repeated, also as
    `output`, as clients do that know several endpoints: the first that can be written counts.
    Raises Problem 400 if none is known.
    """
    names = [name for key in ("format", "output") for name in given.all(key) if name]
    if not names:
        return request.headers.get("accept")
    if len(names) > MAX_NAMES or any(len(name) > MAX_LETTERS for name in names):
        raise Problem(400, f"give up to {MAX_NAMES} formats, of up to {MAX_LETTERS} letters")
    types = dict.fromkeys(media_type for name in names for media_type in _types_of(name))
    if not types:
        known = ", ".join([*_NAMES, *_SHORT])
        raise Problem(400, f"no format {names[0][:40]!r}; there are: {known}, or a media type")
    return ", ".join(f"{name};q={1 / (n + 1):.3f}" for n, name in enumerate(types))


def _types_of(name: str) -> Iterable[str]:
    """The media types that a name of a format stands for; empty for an unknown name."""
    key = re.sub(r"[-_./+ ]", "", name.lower())
    known = _NAMES.get(_SHORT.get(key, key))
    if known is not None or "/" not in name:
        return known or ()
    # a media type, or several; an unescaped + is a space
    parts = (part.partition(";")[0].strip() for part in name.lower().split(","))
    return (part.replace(" ", "+") for part in parts if part)


def negotiated(request: Request, offered: tuple[str, ...] = (*GRAPH_TYPES, HTML)) -> str:
    """The media type of a document, of those offered; raises NotAcceptableError, or as above."""
    return negotiate(accept_of(request, query_parameters(request)), offered)


def document(triples: Iterable[Triple], media_type: str, prefixes: dict[str, str]) -> bytes:
    """Triples as a document in one of `GRAPH_TYPES`; JSON-LD with its context."""
    form = RdfFormat.from_media_type(media_type)
    assert form is not None
    if form == RdfFormat.JSON_LD:
        return to_jsonld(triples, prefixes).encode()
    statements: Iterable[Triple] | Iterable[Quad] = triples
    if form in (RdfFormat.TRIG, RdfFormat.N_QUADS):
        statements = [Quad(t.subject, t.predicate, t.object) for t in triples]
    return serialised(statements, form, prefixes).encode()
