"""Skolemisation: IRIs in place of blank nodes (RDF 1.1 Concepts, section 3.5), and back.

A SPARQL update cannot delete a blank node, and a history cannot identify a changed one. So a map
stores its ontology with an IRI for each blank node: a digest of the node's properties. The same
axiom has the same IRI in every file, and an edit changes the IRIs of the edited axioms only.
Exports contain blank nodes again, because OWL requires them.
"""

from __future__ import annotations

import uuid
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from hashlib import blake2s
from typing import TypeVar

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Store, Triple

from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.quad_store import Object, Subject

_LETTER = "g"  # a node id of RDF/XML begins with a letter
#: properties of OWL with a list whose order has no meaning (unlike owl:propertyChainAxiom)
_SET_PROPERTIES = {
    v.PREFIXES["owl"] + name
    for name in (
        *("members", "distinctMembers", "unionOf", "intersectionOf", "disjointUnionOf"),
        *("oneOf", "hasKey"),
    )
}


def named(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads with an IRI in place of each blank node, without duplicates.

    Nodes with the same properties become one. Raises OntologyError for a cycle of blank nodes,
    which OWL 2 DL does not allow.
    """
    quads = with_sorted_sets(_as_stored(anonymous(quads)))
    about: dict[BlankNode, list[Quad]] = defaultdict(list)
    pointing: dict[BlankNode, list[Quad]] = defaultdict(list)
    for quad in quads:
        if isinstance(quad.subject, BlankNode):
            about[quad.subject].append(quad)
        if isinstance(quad.object, BlankNode):
            pointing[quad.object].append(quad)
    inner_first = _inner_first(about, pointing)
    content: dict[object, str] = {}
    for node in inner_first:
        content[node] = _digest(
            f"{q.predicate} {content.get(q.object, q.object)}" for q in about[node]
        )
    names: dict[object, NamedNode] = {}
    for node in reversed(inner_first):
        above = (f"{names.get(q.subject, q.subject)} {q.predicate}" for q in pointing[node])
        names[node] = NamedNode(v.GENID + _digest([content[node], *sorted(above)]))
    return tuple(dict.fromkeys(with_names(quads, names)))


_Node = TypeVar("_Node")


class StableNodes:
    """Names blank nodes ``prefix0``, ``prefix1``, ... in the order in which they are given."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._names: dict[object, BlankNode] = {}

    def __call__(self, term: _Node) -> _Node | BlankNode:
        """The new name of a blank node; other terms are themselves."""
        if not isinstance(term, BlankNode):
            return term
        return self._names.setdefault(term, BlankNode(f"{self._prefix}{len(self._names)}"))


def with_names(quads: Iterable[Quad], names: Mapping[object, NamedNode]) -> Iterator[Quad]:
    """The quads with the IRIs of `names` in place of those subjects and objects."""
    for quad in quads:
        subject, value = names.get(quad.subject, quad.subject), names.get(quad.object, quad.object)
        yield Quad(subject, quad.predicate, value, quad.graph_name)


def with_fresh_iris(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The quads with a new, unique IRI in place of each blank node."""
    fresh: dict[BlankNode, NamedNode] = {}

    def skolem(term: Subject | Object) -> Subject | Object:
        if isinstance(term, BlankNode):
            return fresh.setdefault(term, NamedNode(v.GENID + uuid.uuid4().hex))
        if isinstance(term, Triple):
            parts = skolem(term.subject), term.predicate, skolem(term.object)
            return Triple(*parts)  # type: ignore[arg-type]
        return term

    for quad in quads:
        subject, value = skolem(quad.subject), skolem(quad.object)
        yield Quad(subject, quad.predicate, value, quad.graph_name)  # type: ignore[arg-type]


def anonymous(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The quads with a blank node in place of each such IRI; the inverse of `named`."""
    for quad in quads:
        subject, value = quad.subject, quad.object
        bare, bare_value = _without_name(subject), _without_name(value)
        if bare is subject and bare_value is value:
            yield quad
        else:
            yield Quad(bare, quad.predicate, bare_value, quad.graph_name)  # type: ignore[arg-type]


def anonymous_triple(triple: Triple) -> Triple:
    """As `anonymous`, for a single triple."""
    subject, value = _without_name(triple.subject), _without_name(triple.object)
    return Triple(subject, triple.predicate, value)  # type: ignore[arg-type]


def _without_name(term: Subject | Object) -> Subject | Object:
    if isinstance(term, NamedNode) and term.value.startswith(v.GENID):
        return BlankNode(_LETTER + term.value.removeprefix(v.GENID))
    return term


def _as_stored(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads in their order, with numbers in the lexical form of the engine (0.2e0 as 0.2)."""
    quads = tuple(quads)
    kept = _as_kept({q.object for q in quads if isinstance(q.object, Literal)})
    return tuple(
        dict.fromkeys(
            Quad(q.subject, q.predicate, kept.get(q.object, q.object), q.graph_name) for q in quads
        )
    )


def _as_kept(literals: Iterable[Literal]) -> dict[object, Literal]:
    """Each literal of an XML Schema type but texts, and the one that the engine returns for it."""
    text = v.XSD + "string"
    kinds = ((literal, literal.datatype.value) for literal in literals)
    typed = [literal for literal, kind in kinds if kind.startswith(v.XSD) and kind != text]
    store, predicate = Store(), NamedNode(v.RDFS_LABEL)
    nodes = [BlankNode() for _ in typed]
    store.extend(Quad(*pair) for pair in zip(nodes, [predicate] * len(nodes), typed, strict=True))
    returned = {quad.subject: quad.object for quad in store}
    return {literal: returned[node] for literal, node in zip(typed, nodes, strict=True)}


def _inner_first(
    about: dict[BlankNode, list[Quad]], pointing: dict[BlankNode, list[Quad]]
) -> list[BlankNode]:
    """All blank nodes; each follows the nodes it points at."""
    sorter: TopologicalSorter[BlankNode] = TopologicalSorter()
    for node in (*about, *pointing):
        below = (q.object for q in about.get(node, ()))
        sorter.add(node, *(term for term in below if isinstance(term, BlankNode)))
    try:
        return list(sorter.static_order())
    except CycleError as error:
        raise OntologyError(
            "blank nodes of the ontology point at each other in a circle; give them IRIs"
        ) from error


def _digest(lines: Iterable[str]) -> str:
    return blake2s("\n".join(sorted(set(lines))).encode(), digest_size=12).hexdigest()


def with_sorted_sets(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads with sorted members in each RDF list of IRIs that OWL reads as a set.

    Editors write such a list (disjoint classes, for instance) in any order. Lists with other
    members are left alone.
    """
    quads = tuple(quads)
    members_of = ListMembers(quads)
    placed: dict[Object, Object] = {}
    for quad in quads:
        if quad.predicate.value in _SET_PROPERTIES and isinstance(quad.object, BlankNode):
            nodes, members = members_of(quad.object)
            if all(isinstance(member, NamedNode) for member in members):
                placed.update(zip(nodes, sorted(members, key=str), strict=True))
    return tuple(
        Quad(q.subject, q.predicate, placed.get(q.subject) or q.object, q.graph_name)
        if q.predicate.value == v.RDF_FIRST
        else q
        for q in quads
    )


class ListMembers:
    """The RDF lists in quads: ``members(head)`` has the nodes of a list, and its members."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        self._first: dict[Object, Object] = {}
        self._rest: dict[Object, Object] = {}
        for quad in quads:
            if quad.predicate.value == v.RDF_FIRST:
                self._first[quad.subject] = quad.object
            elif quad.predicate.value == v.RDF_REST:
                self._rest[quad.subject] = quad.object

    def __call__(self, head: Object) -> tuple[list[Object], list[Object]]:
        """Nodes and members up to the end, or the node where a list goes round in a circle."""
        nodes: dict[Object, None] = {}
        while head in self._first and head not in nodes:
            nodes[head] = None
            head = self._rest.get(head)
        return [*nodes], [self._first[node] for node in nodes]
