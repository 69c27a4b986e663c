"""HTTP content negotiation: the format of an answer (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from kg.model.errors import NotAcceptableError

#: Media types of several formats: JSON-LD or results in JSON, RDF/XML or results in XML.
ALIASES = ("application/json", "application/xml", "text/xml")
#: Media types of tables and truth values, the preferred first.
RESULT_TYPES = (
    "application/sparql-results+json",
    "application/sparql-results+xml",
    "text/csv",
    "text/tab-separated-values",
    *ALIASES,
)
#: Media types of triples, the preferred first.
GRAPH_TYPES = (
    "text/turtle",
    "application/n-triples",
    "application/ld+json",
    "application/rdf+xml",
    "application/trig",
    "application/n-quads",
    "text/n3",
    *ALIASES,
)


def negotiate(accept: str | None, offered: tuple[str, ...]) -> str:
    """The best of the media types offered, in order of preference, for an Accept header.

    The most specific matching range gives the quality of a type (its q-value); of equal types the
    first is taken. Raises NotAcceptableError if no type is acceptable.
    """
    ranges = _ranges(accept or "")
    if not ranges:
        return offered[0]
    best = max(offered, key=lambda offer: _quality(offer, ranges))
    if _quality(best, ranges) <= 0:
        raise NotAcceptableError(f"cannot answer as {accept!r}; there are: {', '.join(offered)}")
    return best


def _ranges(accept: str) -> dict[str, float]:
    ranges: dict[str, float] = {}
    for part in accept.split(","):
        name, *parameters = (piece.strip().lower() for piece in part.split(";"))
        if name:
            quality = next((p[2:] for p in parameters if p.startswith("q=")), "1")
            ranges[name] = max(ranges.get(name, 0.0), _number(quality))
    return ranges


def _quality(offer: str, ranges: dict[str, float]) -> float:
    for name in (offer, f"{offer.partition('/')[0]}/*", "*/*"):
        if name in ranges:
            return ranges[name]
    return 0.0


def _number(text: str) -> float:
    try:
        quality = float(text)
    except ValueError:
        return 0.0
    return quality if 0 <= quality <= 1 else 0.0
