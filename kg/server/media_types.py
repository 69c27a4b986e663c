"""The media types of documents of triples, and writing them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from pyoxigraph import Quad, RdfFormat, Triple, serialize

from kg import vocabulary as v
from kg.characters import in_xml
from kg.jsonld import to_jsonld

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


def document(triples: Iterable[Triple], media_type: str, prefixes: dict[str, str]) -> bytes:
    """Triples as a document of one of `GRAPH_FORMATS`, JSON-LD with its context."""
    form = GRAPH_FORMATS[media_type]
    if form == RdfFormat.JSON_LD:
        return to_jsonld(triples, prefixes).encode()
    if form in (RdfFormat.TRIG, RdfFormat.N_QUADS):
        quads = [Quad(t.subject, t.predicate, t.object) for t in triples]
        return serialize(quads, format=form, prefixes=prefixes) or b""
    body = serialize(triples, format=form, prefixes=prefixes) or b""
    return in_xml(body) if form == RdfFormat.RDF_XML else body


def prefixes_of(base: str) -> dict[str, str]:
    """The vocabulary's prefixes, and those of the map's own things."""
    kinds = ("object", "observation", "place", "recording")
    return {**v.PREFIXES, "map": base, **{kind: f"{base}{kind}/" for kind in kinds}}
