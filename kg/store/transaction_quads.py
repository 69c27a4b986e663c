"""Quads of a transaction: checks before they are written, and the quad with its number."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.rdf.quad_store import QuadStore
from kg.rdf.xml_characters import unwritable


def check_blank_nodes(quads: Iterable[Quad]) -> None:
    """Raise InvalidFactError for a blank node.

    An update renames the blank nodes that it inserts, and it cannot delete any.
    """
    for quad in quads:
        if isinstance(quad.subject, BlankNode) or isinstance(quad.object, BlankNode):
            raise InvalidFactError(f"a blank node cannot be written: {quad.triple}; give it an IRI")


def check_characters(quads: Iterable[Quad]) -> None:
    """Raise InvalidFactError for a text that XML cannot represent."""
    for quad in quads:
        text = quad.object.value if isinstance(quad.object, Literal) else ""
        if (character := unwritable(text)) is not None:
            raise InvalidFactError(
                f"a text with {character} cannot be written, since XML cannot represent it: "
                f"{text[:60]!r}, {quad.predicate} of {quad.subject}; leave that character out"
            )


def sequence_quad(number: int) -> Quad:
    """The quad that states the number of the last stored transaction."""
    graph = v.DATASET_GRAPH
    return Quad(graph, NamedNode(v.SEQUENCE), Literal(number), graph)


def stored_sequence(engine: QuadStore) -> int:
    """The number of the last transaction in a store; 0 before the first."""
    graph = v.DATASET_GRAPH
    quads = engine.quads_for_pattern(graph, NamedNode(v.SEQUENCE), None, graph)
    return max((int(q.object.value) for q in quads if isinstance(q.object, Literal)), default=0)
