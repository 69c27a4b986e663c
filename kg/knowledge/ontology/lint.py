"""Validation of ontologies and maps: SHACL shapes, and rules that SHACL cannot express.

The shapes are data (``ontologies/shapes.ttl``). These checks are code: terms used are declared,
each property is of one kind (OWL 2 DL), the compiled view of a map is that of its ontology.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key
from kg.knowledge.ontology.loading import (
    SHAPES_FILE,
    check_limits,
    compile_commonsense,
    load_ontologies,
    superclasses,
)
from kg.knowledge.ontology.relations import relations
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.resources import ONTOLOGIES
from kg.rdf.findings import Finding

_PROPERTY_KINDS: Final = {
    v.OWL_OBJECT_PROPERTY: "object",
    v.OWL_DATATYPE_PROPERTY: "data",
    v.OWL_ANNOTATION_PROPERTY: "annotation",
}
_BUILT_IN: Final = tuple(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl"))


def check_ontologies(folder: Path = ONTOLOGIES) -> list[Finding]:
    """Validation findings for the ontologies of a folder; empty where there are none.

    Uses the folder's own ``shapes.ttl`` where it has one, the shipped shapes otherwise.

    Raises:
        OntologyError: there are none, or one does not parse.
    """
    return check_quads(load_ontologies(folder).quads, shapes_of(folder))


def shapes_of(folder: Path) -> Path:
    """Shapes file for the ontologies of a folder: its own, or else the shipped one."""
    own = folder / SHAPES_FILE
    return own if own.is_file() else ONTOLOGIES / SHAPES_FILE


def check_quads(quads: Iterable[Quad], shapes: Path = ONTOLOGIES / SHAPES_FILE) -> list[Finding]:
    """As `check_ontologies`, of an ontology given as quads with blank nodes."""
    return list(_findings(tuple(quads), shapes, shapes.stat().st_mtime_ns))


@lru_cache(maxsize=1)  # a reload validates the same quads where they are read and where written
def _findings(quads: tuple[Quad, ...], shapes: Path, _modified: int) -> tuple[Finding, ...]:
    from kg.rdf.shacl import validate

    try:
        check_limits(quads)
    except OntologyError as error:  # the shapes would take minutes
        return (Finding(focus="owl:Ontology", message=str(error)),)
    # restrictions have no labels: only named classes are validated as terms
    named = [q for q in quads if not (isinstance(q.subject, BlankNode) and _is_class(q))]
    found = validate(named, shapes)
    found += _undeclared(quads, _declared(quads))
    found += _undeclared_properties(quads)
    found += _mixed_kinds(quads)
    found += _objects_and_places(quads)
    found += _same_names(quads)
    try:
        relations(quads)
    except OntologyError as error:
        found.append(Finding(focus="here:probability", message=str(error)))
    return tuple(sorted(set(found)))


def check_map(quads: Iterable[Quad], shapes: Path = ONTOLOGIES / SHAPES_FILE) -> list[Finding]:
    """Validation findings for a map, given all its quads (such as a pyoxigraph Store).

    The present belief (graph:map), assertions (graph:assertions) and the map's own
    description (graph:dataset) are held to the shapes; every graph may use only declared terms;
    graph:commonsense must hold what the map's ontology compiles to.
    """
    from kg.rdf.shacl import validate

    graphs: dict[str, list[Quad]] = defaultdict(list)
    for q in quads:
        graphs[q.graph_name.value if isinstance(q.graph_name, NamedNode) else ""].append(q)
    ontology = graphs.pop(v.ONTOLOGY_GRAPH.value, [])
    if not ontology:
        message = "the map holds no ontology; load one into this graph"
        return [Finding(focus=v.ONTOLOGY_GRAPH.value, message=message)]
    hierarchy = [q for q in ontology if q.predicate.value == v.RDFS_SUB_CLASS_OF]
    shaped = (v.MAP_GRAPH.value, v.DATASET_GRAPH.value, v.ASSERTIONS_GRAPH.value)
    found = validate([*(q for graph in shaped for q in graphs[graph]), *hierarchy], shapes)
    declared = _declared(ontology)
    for facts in graphs.values():
        found += _undeclared(facts, declared)
    found += _not_compiled(ontology, graphs[v.COMMONSENSE_GRAPH.value])
    return sorted(set(found))


def _is_class(q: Quad) -> bool:
    return q.predicate == v.RDF_TYPE and q.object == NamedNode(v.OWL_CLASS)


def _declared(ontology: Iterable[Quad]) -> set[str]:
    kinds = {v.OWL_CLASS, *_PROPERTY_KINDS}
    return {
        q.subject.value
        for q in ontology
        if q.predicate == v.RDF_TYPE
        and isinstance(q.subject, NamedNode)
        and isinstance(q.object, NamedNode)
        and q.object.value in kinds
    }


def _undeclared(quads: Iterable[Quad], declared: set[str]) -> list[Finding]:
    """One finding for each here: term that is used, in whatever position, and not declared."""
    uses: dict[str, str] = {}
    for q in quads:
        for term in (q.subject, q.predicate, q.object):
            if not isinstance(term, NamedNode) or not term.value.startswith(v.HERE):
                continue
            if term.value not in declared and term.value != v.HERE:
                uses.setdefault(term.value, _text(q.subject))
    message = "the ontology declares no such term"
    return [Finding(focus=user, message=message, value=term) for term, user in uses.items()]


def _undeclared_properties(quads: Iterable[Quad]) -> list[Finding]:
    """Borrowed properties used without a declaration: OWL 2 DL wants one."""
    quads = tuple(quads)
    known = (*_BUILT_IN, v.HERE)
    used = {q.predicate.value for q in quads if not q.predicate.value.startswith(known)}
    message = "a property is used that no ontology declares"
    return [Finding(focus=iri, message=message) for iri in used - _declared(quads)]


def _mixed_kinds(quads: Iterable[Quad]) -> list[Finding]:
    kinds: dict[str, set[str]] = defaultdict(set)
    for q in quads:
        of_type = q.object.value if isinstance(q.object, NamedNode) else ""
        if q.predicate == v.RDF_TYPE and of_type in _PROPERTY_KINDS:
            kinds[_text(q.subject)].add(_PROPERTY_KINDS[of_type])
    return [
        Finding(focus=iri, message=f"is a property of two kinds: {' and '.join(sorted(of))}")
        for iri, of in kinds.items()
        if len(of) > 1
    ]


def _objects_and_places(quads: Iterable[Quad]) -> list[Finding]:
    """Categories that are both object and place; HermiT, where it runs, reports them too."""
    message = "is a kind of here:Object and of here:Place; it can be one of them"
    return [
        Finding(focus=iri, message=message)
        for iri, above in superclasses(quads).items()
        if v.OBJECT in above and v.PLACE in above
    ]


def _same_names(quads: Iterable[Quad]) -> list[Finding]:
    """Categories with the label of another, which takes precedence in lookups."""
    called: dict[tuple[str, str], list[Category]] = defaultdict(list)
    for category in Catalogue.from_quads(quads).categories:
        if not category.provisional:
            called[category.kind, name_key(category.label)].append(category)
    return [
        Finding(
            focus=other.iri,
            message=f"has the label of {first.iri.replace(v.HERE, 'here:')}, which it then means",
            path=v.RDFS_LABEL,
            value=other.label,
            severity="warning",
        )
        for first, *others in called.values()
        for other in others
    ]


def _not_compiled(ontology: list[Quad], commonsense: list[Quad]) -> list[Finding]:
    stated = set(commonsense)
    there = {q.subject for q in commonsense if _text(q.subject).startswith(v.RELATION)}
    try:
        # a relation edited by SPARQL is present, though not as compiled
        missing = {
            q for q in compile_commonsense(ontology) if q not in stated and q.subject not in there
        }
    except OntologyError as error:
        return [Finding(focus=v.ONTOLOGY_GRAPH.value, message=str(error))]
    if not missing:
        return []
    message = f"lacks {len(missing)} facts that the map's ontology compiles to; compile it again"
    return [Finding(focus=v.COMMONSENSE_GRAPH.value, message=message)]


def _text(term: object) -> str:
    return term.value if isinstance(term, NamedNode) else str(term)
