"""Serialisation of graphs of a snapshot in a worker: dumps and single graphs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import IO, Any, cast

from pyoxigraph import NamedNode, RdfFormat, Store, Triple, serialize

from kg.rdf.skolem import anonymous_triple


def write_graphs(store: Store, request: Mapping[str, Any], sink: object) -> None:
    """Write to `sink` all named graphs, or the triples of one.

    ``whole`` selects every quad; else ``graph`` names one graph, or is None for their union.
    """
    form = RdfFormat.from_media_type(request["media_type"])
    assert form is not None
    out = cast(IO[bytes], sink)
    if request["whole"]:
        store.dump(out, form, prefixes=request["prefixes"])
    else:
        triples = _triples(store, request["graph"])
        serialize(triples, out, form, prefixes=request["prefixes"])


def _triples(store: Store, iri: str | None) -> Iterator[Triple]:
    graph = None if iri is None else NamedNode(iri)
    seen: set[Triple] = set()
    for quad in store.quads_for_pattern(None, None, None, graph):
        if graph is None:
            # one triple may be in several graphs
            if quad.triple in seen:
                continue
            seen.add(quad.triple)
        yield anonymous_triple(quad.triple)
