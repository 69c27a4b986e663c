"""Canonical order of RDF lists that OWL uses as sets, such as those of disjoint classes.

Editors write such a list in whatever order they hold the set. Sorted, the same axiom is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.model import vocabulary as v
from kg.rdf.quad_store import Object, Subject

#: what points at lists whose order means nothing (not owl:propertyChainAxiom)
_SETS: Final = {
    v.PREFIXES["owl"] + name
    for name in (
        "members",
        "distinctMembers",
        "unionOf",
        "intersectionOf",
        "disjointUnionOf",
        "oneOf",
        "hasKey",
    )
}


def with_sorted_sets(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads with each such list of IRIs sorted; lists of anything else stay as they are."""
    quads = tuple(quads)
    first: dict[Subject, Object] = {
        q.subject: q.object for q in quads if q.predicate.value == v.RDF_FIRST
    }
    rest: dict[Subject, Object] = {
        q.subject: q.object for q in quads if q.predicate.value == v.RDF_REST
    }
    placed: dict[Subject, Object] = {}
    for quad in quads:
        if quad.predicate.value in _SETS and isinstance(quad.object, BlankNode):
            nodes = list(_nodes(quad.object, rest))
            members = [first.get(node) for node in nodes]
            if all(isinstance(member, NamedNode) for member in members):
                placed.update(zip(nodes, sorted(members, key=str), strict=True))
    return tuple(
        Quad(q.subject, q.predicate, placed.get(q.subject) or q.object, q.graph_name)
        if q.predicate.value == v.RDF_FIRST
        else q
        for q in quads
    )


def _nodes(head: Object, rest: dict[Subject, Object]) -> Iterator[BlankNode]:
    visited: set[object] = set()
    while isinstance(head, BlankNode) and head not in visited:
        visited.add(head)
        yield head
        head = rest.get(head)
