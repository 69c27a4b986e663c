"""Validation of ontologies and maps: SHACL shapes, and rules that SHACL cannot express.

The shapes are data (``ontologies/shapes.ttl``). These checks are code: terms used are declared,
each property is of one kind (OWL 2 DL), the compiled view of a map is that of its ontology.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key, shipped_ontology
from kg.knowledge.ontology.declared_terms import like_declared
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
from kg.rdf.skolem import ListMembers, named

_PROPERTY_KINDS: Final = {
    v.OWL_OBJECT_PROPERTY: "object",
    v.OWL_DATATYPE_PROPERTY: "data",
    v.OWL_ANNOTATION_PROPERTY: "annotation",
}
#: vocabularies whose properties need no declaration; the last one is of obsolete terms in Protege
_BUILT_IN: Final = (
    *(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl")),
    "http://purl.obolibrary.org/obo/IAO_",
)


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
    """As `check_ontologies`, of an ontology given as quads; blank nodes get their IRIs in maps."""
    quads = tuple(quads)
    if any(isinstance(term, BlankNode) for q in quads for term in (q.subject, q.object)):
        quads = named(quads)
    return list(_findings(quads, shapes, shapes.stat().st_mtime_ns))


@lru_cache(maxsize=1)  # a reload validates the same quads where they are read and where written
def _findings(quads: tuple[Quad, ...], shapes: Path, _modified: int) -> tuple[Finding, ...]:
    from kg.rdf.shacl import validate

    try:
        check_limits(quads)
    except OntologyError as error:  # the shapes would take minutes
        return (Finding(focus="owl:Ontology", message=str(error)),)
    # restrictions have no labels: only named classes are validated as terms
    terms = [q for q in quads if not (_text(q.subject).startswith(v.GENID) and _is_class(q))]
    shipped = shapes == ONTOLOGIES / SHAPES_FILE
    found = validate(_to_validate(terms) if shipped else terms, shapes)
    found += _undeclared(quads, _declared(quads))
    found += _undeclared_properties(quads)
    found += _mixed_kinds(quads)
    found += _disjoint(quads)
    found += _same_names(quads)
    try:
        relations(quads)
    except OntologyError as error:
        found.append(Finding(focus="here:probability", message=str(error)))
    return tuple(sorted(set(found)))


def _to_validate(quads: list[Quad]) -> Iterable[Quad]:
    """The quads without those of the shipped ontology that are valid in any case.

    Those would take seconds. What is left about an unchanged subject is its class, which others may
    need. Subjects that depend on a class which `quads` lack or place elsewhere stay whole.
    """
    shipped = {q for q in shipped_ontology().quads if q.graph_name == v.ONTOLOGY_GRAPH}
    given = set(quads)
    if shipped >= given:
        return quads
    of_classes = (v.RDF_TYPE.value, v.RDFS_SUB_CLASS_OF)
    lost = {_text(q.subject) for q in shipped - given if q.predicate.value in of_classes}
    lost |= {iri for iri, above in superclasses(shipped).items() if lost & {*above}}
    whole = {_text(q.subject) for q in given ^ shipped}
    whole |= {_text(q.subject) for q in given if lost & {_text(q.subject), _text(q.object)}}
    kept = (*of_classes, v.RDFS_LABEL, v.RDFS_COMMENT)
    classes = {q.subject for q in quads if _is_class(q)}
    return (
        q
        for q in quads
        if _text(q.subject) in whole or (q.subject in classes and q.predicate.value in kept)
    )


def check_map(quads: Iterable[Quad]) -> list[Finding]:
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
    facts_of_shapes = [*(q for graph in shaped for q in graphs[graph]), *hierarchy]
    found = validate(facts_of_shapes, ONTOLOGIES / SHAPES_FILE)
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
    return [
        Finding(focus=user, message=message + like_declared(term, declared), value=term)
        for term, user in uses.items()
    ]


def _undeclared_properties(quads: Iterable[Quad]) -> list[Finding]:
    """Borrowed properties used without a declaration: OWL 2 DL wants one."""
    quads = tuple(quads)
    known = (*_BUILT_IN, v.HERE)
    used = {q.predicate.value for q in quads if not q.predicate.value.startswith(known)}
    declared = _declared(quads)
    message = "a property is used that no ontology declares"
    return [Finding(iri, message + like_declared(iri, declared)) for iri in used - declared]


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


def _disjoint(quads: Iterable[Quad]) -> list[Finding]:
    """Classes under two classes that exclude each other; HermiT, where it runs, finds more."""
    quads = tuple(quads)
    excluded = _disjoint_pairs(quads)
    message = "is a kind of {} and of {}; it can be one of them"
    return [
        Finding(iri, message.format(*(one.replace(v.HERE, "here:") for one in pair)))
        for iri, above in superclasses(quads).items()
        for pair in combinations(above, 2)
        if frozenset(pair) in excluded
    ]


def _disjoint_pairs(quads: tuple[Quad, ...]) -> set[frozenset[str]]:
    """The pairs of classes of owl:disjointWith and owl:AllDisjointClasses."""
    members_of = ListMembers(quads)
    pairs = {frozenset((v.OBJECT, v.PLACE))}
    for q in quads:
        if q.predicate.value == v.OWL_DISJOINT_WITH:
            pairs.add(frozenset((_text(q.subject), _text(q.object))))
        elif q.predicate.value == v.OWL_MEMBERS:
            members = dict.fromkeys(map(_text, members_of(q.object)[1]))
            pairs |= {frozenset(pair) for pair in combinations(members, 2)}
    return pairs


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
