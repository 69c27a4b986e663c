"""Quad store protocol: the interface between a map and its store, in this process or over HTTP.

pyoxigraph's `Store` and `kg.store.sparql_backend.SparqlBackend` implement it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, Triple

from kg.model import vocabulary as v

Term = NamedNode | BlankNode | Literal | Triple
Subject = NamedNode | BlankNode | Triple | None
Object = NamedNode | BlankNode | Literal | Triple | None
Functions = dict[NamedNode, Callable[..., NamedNode | BlankNode | Literal | Triple | None]]


class QuadStore(Protocol):
    """A dataset that can be read by pattern and queried."""

    def quads_for_pattern(
        self,
        subject: Subject,
        predicate: NamedNode | None,
        object: Object,
        graph_name: NamedNode | BlankNode | DefaultGraph | None = None,
        /,
    ) -> Iterator[Quad]:
        """The matching quads; None matches anything."""

    def query(
        self,
        query: str,
        /,
        *,
        base_iri: str | None = None,
        prefixes: dict[str, str] | None = None,
        use_default_graph_as_union: bool = False,
        custom_functions: Functions | None = None,
    ) -> Any:
        """Solutions (with `variables`), a boolean, or triples, by the form of the query.

        Relative IRIs are resolved against `base_iri` unless the query has a BASE. Raises
        SyntaxError where the query does not parse.
        """

    def __contains__(self, quad: Any, /) -> bool: ...

    def __iter__(self) -> Iterator[Quad]: ...


def subcategories(store: QuadStore, category: str) -> frozenset[str]:
    """IRIs of a category and of all its subcategories."""
    isa, above = NamedNode(v.IS_A), NamedNode(category)
    quads = store.quads_for_pattern(None, isa, above, v.COMMONSENSE_GRAPH)
    found = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return frozenset(found | {category})
