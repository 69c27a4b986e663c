"""Blank nodes under names, and back: a map must be able to refer to every node it holds.

A SPARQL update cannot delete a blank node, and a history cannot say which one changed. So a map
holds its ontology with an IRI for each blank node (RDF 1.1 Concepts, section 3.5), made of what is
said of the node: the same axiom has the same IRI whoever wrote the file, and an edit changes the
names of what it touches and of nothing else. Whatever leaves the map has blank nodes again, because
OWL wants them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from hashlib import blake2s

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Store, Triple

from kg import vocabulary as v
from kg.engine import Object, Subject
from kg.errors import OntologyError
from kg.set_lists import with_sorted_sets

_LETTER = "g"  # a node id of RDF/XML begins with a letter


def named(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads with an IRI in place of each blank node; each quad once, as a store holds it.

    Nodes of which the same is said become one. Raises OntologyError for blank nodes that point at
    each other in a circle, which OWL 2 DL has not.
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
    content: dict[BlankNode, str] = {}
    for node in inner_first:
        said = (f"{q.predicate} {_known(q.object, content)}" for q in about[node])
        content[node] = _digest(said)
    names: dict[object, NamedNode] = {}
    for node in reversed(inner_first):
        above = (f"{names.get(q.subject, q.subject)} {q.predicate}" for q in pointing[node])
        names[node] = NamedNode(v.GENID + _digest([content[node], *sorted(above)]))
    return tuple(
        dict.fromkeys(
            Quad(
                names.get(q.subject, q.subject),
                q.predicate,
                names.get(q.object, q.object),
                q.graph_name,
            )
            for q in quads
        )
    )


def anonymous(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The quads with a blank node in place of each such IRI: what `named` was given."""
    for quad in quads:
        subject, predicate, value, graph = quad
        bare, bare_value = _without_name(subject), _without_name(value)
        if bare is subject and bare_value is value:
            yield quad
        else:
            yield Quad(bare, predicate, bare_value, graph)  # type: ignore[arg-type]


def anonymous_triple(triple: Triple) -> Triple:
    """A single triple as `anonymous` gives it."""
    subject, value = _without_name(triple.subject), _without_name(triple.object)
    return Triple(subject, triple.predicate, value)  # type: ignore[arg-type]


def _without_name(term: Subject | Object) -> Subject | Object:
    if isinstance(term, NamedNode) and term.value.startswith(v.GENID):
        return BlankNode(_LETTER + term.value.removeprefix(v.GENID))
    return term


def _as_stored(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads in their order, numbers written as the engine keeps them (0.2e0 as 0.2)."""
    store = Store()
    found: dict[Quad, None] = {}
    for quad in quads:
        if isinstance(quad.object, Literal) and quad.object.datatype.value.startswith(v.XSD):
            store.add(quad)
            found.update(dict.fromkeys(store))
            store.clear()
        else:
            found[quad] = None
    return tuple(found)


def _known(term: Object, content: dict[BlankNode, str]) -> str:
    return content[term] if isinstance(term, BlankNode) else str(term)


def _inner_first(
    about: dict[BlankNode, list[Quad]], pointing: dict[BlankNode, list[Quad]]
) -> list[BlankNode]:
    """All blank nodes, each after those that it points at."""
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
