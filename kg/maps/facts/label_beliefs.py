"""Alternative classes of an object, each a node with a probability.

The probability of an alternative is that a thing of that class is there, as `here:existence` is for
the object's own class. The probabilities of all classes and of no object at all add up to 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.rdf.literals import Properties, first, iri_node, known_iri, number_literal, quantised
from kg.rdf.quad_store import QuadStore

STEP: Final = 0.05  # of quantised probabilities; less probable alternatives are not stored
MAX_ALTERNATIVES: Final = 3  # alternatives of one object
#: Predicates of the nodes, and of an object that links them.
OWN: Final = frozenset((v.HAS_LABEL_BELIEF, v.LABEL_PROBABILITY))

_HAS: Final = NamedNode(v.HAS_LABEL_BELIEF)


def label_quads(iri: str, labels: Mapping[str, float]) -> list[Quad]:
    """Facts of the alternatives of the object `iri`, which are categories of objects.

    The most probable ones are stored, from 0.05 on. Raises InvalidFactError for probabilities that
    are not finite or out of range.
    """
    what, thing = f"label belief of {iri}", iri_node(iri, "object")
    quads = list[Quad]()
    for category, probability in stored_labels(labels, what).items():
        node = known_iri(f"{iri}/label/{quote(category.removeprefix(v.HERE), safe='')}")
        quads += [
            Quad(thing, _HAS, node, v.MAP_GRAPH),
            Quad(node, v.RDF_TYPE, known_iri(v.LABEL_BELIEF), v.MAP_GRAPH),
            Quad(node, known_iri(v.OF_CATEGORY), iri_node(category, what), v.MAP_GRAPH),
            Quad(node, known_iri(v.LABEL_PROBABILITY), Literal(probability), v.MAP_GRAPH),
        ]
    return quads


def stored_labels(labels: Mapping[str, float], what: str) -> dict[str, float]:
    """Alternatives as they are stored: quantised, the most probable ones first."""
    for probability in labels.values():
        number_literal(probability, what, minimum=0.0, maximum=1.0)
    steps = {category: quantised(p / STEP, what, 0) * STEP for category, p in labels.items()}
    likely = sorted(labels, key=lambda category: (-labels[category], category))[:MAX_ALTERNATIVES]
    return {c: round(steps[c], 2) for c in likely if labels[c] >= STEP}


def label_nodes(store: QuadStore, iri: str) -> Iterator[NamedNode]:
    """Nodes of an object's alternatives."""
    for quad in store.quads_for_pattern(iri_node(iri, "object"), _HAS, None, v.MAP_GRAPH):
        if isinstance(quad.object, NamedNode):
            yield quad.object


def labels_of(properties: Properties, subjects: Mapping[str, Properties]) -> dict[str, float]:
    """Alternatives of an object with `properties`, whose nodes are among `subjects`."""
    found = dict[str, float]()
    for iri in properties.get(v.HAS_LABEL_BELIEF, ()):
        node = subjects.get(iri, {})
        if v.OF_CATEGORY in node and v.LABEL_PROBABILITY in node:
            found[first(node, v.OF_CATEGORY, "")] = float(first(node, v.LABEL_PROBABILITY, "0"))
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))
