"""Ontologies in owlready2: classes as Python objects, and OWL reasoners."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from typing import Any

import owlready2
from pyoxigraph import NamedNode, Quad, RdfFormat, serialize

from kg import vocabulary as v


def load_world(quads: Iterable[Quad]) -> Any:
    """A fresh owlready2 World that holds the quads as one ontology.

    ``world[iri]`` is a class or property; ``world.classes()`` are all. It is handed over as
    N-Triples, because owlready2 0.51 reads a Turtle file without complaint and without a class.
    Headers are left out: owlready2 would fetch what they import, and take the first for the
    namespace of all terms.
    """
    quads = tuple(quads)
    headers = {q.subject for q in quads if q.object == NamedNode(v.OWL_ONTOLOGY)}
    triples = [q.triple for q in quads if q.subject not in headers]
    n_triples = serialize(triples, format=RdfFormat.N_TRIPLES) or b""
    world = owlready2.World()
    world.get_ontology(v.HERE).load(fileobj=BytesIO(n_triples))
    return world


def inconsistent_classes(world: Any) -> tuple[str, ...]:
    """IRIs of the classes that can have no members, by HermiT; sorted. Needs Java.

    Raises:
        owlready2.OwlReadyInconsistentOntologyError: the ontology as a whole contradicts itself.
    """
    owlready2.sync_reasoner_hermit(world, debug=0)
    return tuple(sorted(c.iri for c in world.inconsistent_classes() if c is not owlready2.Nothing))
