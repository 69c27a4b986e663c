"""Ontology loading: files to quads of graph:ontology, compiled to those of graph:commonsense.

The compiled view exists because queries want one triple where OWL needs several: `here:isA` closes
`rdfs:subClassOf`, and every `here:locatedAt` / `here:nearBy` becomes one node that carries its
classes, probability and source (docs/explanation/ontology.md).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.relations import CategoryRelation, Notes, annotated_key, relations
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.resources import ONTOLOGIES
from kg.rdf.findings import Finding
from kg.rdf.literals import subject_quads
from kg.rdf.parsing import ENDINGS, Parse, parse_file
from kg.rdf.quad_store import QuadStore
from kg.rdf.skolem import StableNodes
from kg.store.transaction_quads import MAX_TEXT

#: Shapes validate the other files and are not part of the map.
SHAPES_FILE: Final = "shapes.ttl"

#: Limits of an ontology: validation and the closed hierarchy of larger ones would take minutes.
MAX_CLASSES: Final = 10_000
MAX_LEVELS: Final = 100
MAX_SUPERCLASSES: Final = 100_000  # pairs of a class and a superclass
MAX_ABOVE: Final = 100  # superclasses of one class: each thing of the class gets their types
MAX_RELATIONS: Final = 10_000
MAX_STATEMENTS: Final = 150_000
MAX_LABELS: Final = 200  # of one term

_RELATION_CLASSES: Final = {
    v.LOCATED_AT: NamedNode(v.LOCATED_AT_RELATION),
    v.NEAR_BY: NamedNode(v.NEAR_BY_RELATION),
}
_NAMES: Final = (v.RDFS_LABEL, v.SKOS_ALT_LABEL, v.SKOS_HIDDEN_LABEL)
_OF_AXIOMS: Final = (v.OWL_ANNOTATED_SOURCE, v.OWL_ANNOTATED_PROPERTY, v.OWL_ANNOTATED_TARGET)


@dataclass(frozen=True, slots=True)
class Ontology:
    """An ontology as a map takes it (`ontology_of`), with the files it was read from, if any."""

    quads: tuple[Quad, ...]  # all in graph:ontology
    files: tuple[Path, ...] = ()
    findings: tuple[Finding, ...] = ()  # labels that were read in another spelling


def load_ontologies(folder: Path = ONTOLOGIES, *, without: Path | None = None) -> Ontology:
    """Read every ontology in `folder`: .ttl, .owl and .rdf (RDF/XML), .nt; not ``shapes.ttl``.

    `without` leaves one file out, wherever it lies.

    ``owl:imports`` is not followed: what lies in the folder is the ontology. The same files give
    the same quads, in the same order and with the same blank nodes.

    Raises:
        OntologyError: no such folder, no ontology in it, or a file that does not parse.
    """
    if not folder.is_dir():
        raise OntologyError(f"no ontologies in {folder}: it is not a folder")
    return read_files(given_files(folder, without))


def given_files(folder: Path, without: Path | None = None) -> list[Path]:
    """`ontology_files` but for one file; raises OntologyError where there are none."""
    left_out = without and without.resolve()
    files = [path for path in ontology_files(folder) if path.resolve() != left_out]
    if not files:
        raise OntologyError(f"no ontologies in {folder}: expected files {', '.join(ENDINGS)}")
    return files


def ontology_files(folder: Path) -> list[Path]:
    """The files of a folder that hold ontologies, by name."""
    return sorted(p for p in folder.iterdir() if p.suffix in ENDINGS and p.name != SHAPES_FILE)


def read_files(files: Iterable[Path], parse: Parse | None = None) -> Ontology:
    """Those files and no others as one ontology; raises as `load_ontologies`."""
    files = tuple(files)
    quads: dict[Quad, None] = {}
    for number, path in enumerate(files):
        quads.update(dict.fromkeys(_read(path, parse, prefix=f"o{number}n")))
    return ontology_of(quads, files)


def ontology_of(quads: Iterable[Quad], files: Iterable[Path] = ()) -> Ontology:
    """The ontology of quads as a map takes it, at every way into a map.

    Names lose line ends and the spaces around them. A relation that stands only in its owl:Axiom is
    stated too, as the OWLAPI reads it. A class under a supercategory alone (here:Food) becomes a
    here:Object, since only objects are in supercategories.
    """
    named, findings = _with_clean_names(quads)
    stated = dict.fromkeys((*named, *_annotated_only(named)))
    return Ontology((*stated, *_implied_objects(stated)), tuple(files), tuple(findings))


def _with_clean_names(quads: Iterable[Quad]) -> tuple[tuple[Quad, ...], list[Finding]]:
    clean, found = dict[Quad, None](), []
    for q in quads:
        value = q.object
        if q.predicate.value in _NAMES and isinstance(value, Literal):
            text = " ".join(value.value.split())
            focus = getattr(q.subject, "value", "")
            if not text:
                found.append(Finding(focus, "has an empty name", q.predicate.value))
            elif text != value.value:
                message = f"has spaces or line ends around words of a name; it is read as {text!r}"
                found.append(Finding(focus, message, q.predicate.value, severity="warning"))
                datatype = None if value.language else value.datatype
                value = Literal(text, language=value.language, datatype=datatype)
        clean[Quad(q.subject, q.predicate, value, v.ONTOLOGY_GRAPH)] = None
    return tuple(clean), found


def _annotated_only(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The relations that owl:Axiom nodes annotate."""
    notes: dict[object, Notes] = defaultdict(list)
    for q in quads:
        if q.predicate.value in _OF_AXIOMS:
            notes[q.subject].append((q.predicate.value, q.object))
    for axiom in notes.values():
        key = annotated_key(axiom)
        if key is not None and key[0] in _RELATION_CLASSES:
            kind, subject, target = map(NamedNode, key)
            yield Quad(subject, kind, target, v.ONTOLOGY_GRAPH)


def _implied_objects(quads: Iterable[Quad]) -> Iterator[Quad]:
    """The missing here:Object above classes that are under a supercategory, and under nothing else
    that tells what they are."""
    parents = _parents(quads)
    above = {iri: _reachable(iri, parents) for iri in parents}
    objects = [iri for iri, kinds in above.items() if v.OBJECT in kinds]
    supercategories = set().union(*(above[iri] for iri in objects)) - {*objects}
    placed = {*objects, *supercategories, *(i for i, kinds in above.items() if v.PLACE in kinds)}
    implied = {iri for iri, kinds in above.items() if iri not in placed and kinds & supercategories}
    for iri in sorted(iri for iri in implied if not parents[iri] & implied):
        yield Quad(
            NamedNode(iri), NamedNode(v.RDFS_SUB_CLASS_OF), NamedNode(v.OBJECT), v.ONTOLOGY_GRAPH
        )


def _read(path: Path, parse: Parse | None, *, prefix: str) -> Iterator[Quad]:
    stable = StableNodes(prefix)  # the parser's own names differ from run to run
    for q in parse_file(path, parse) if parse else parse_file(path):
        yield Quad(stable(q.subject), q.predicate, stable(q.object), v.ONTOLOGY_GRAPH)


def superclasses(quads: Iterable[Quad]) -> dict[str, tuple[str, ...]]:
    """Every named class, by IRI, with itself and all its named superclasses; all sorted.

    Follows ``rdfs:subClassOf`` between named classes, through cycles too. Restrictions and
    owl:Thing, which no query uses, are left out.
    """
    parents = _parents(quads)
    return {iri: tuple(sorted(_reachable(iri, parents))) for iri in sorted(parents)}


def check_grown(engine: QuadStore, added: Iterable[Quad]) -> None:
    """As `check_limits`, of the ontology of a map with the quads that would be added to it."""
    stored = engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH)
    check_limits([*stored, *(q for q in added if q.graph_name == v.ONTOLOGY_GRAPH)])


def check_limits(quads: Collection[Quad]) -> None:
    """Check that an ontology has a size that maps can hold; called wherever one is made or grows.

    Raises:
        OntologyError: there are too many statements, relations or labels of a term, a text is too
            long, or the classes form no hierarchy, or too large a one.
    """
    _check_size(quads)
    _check_hierarchy(quads)


def _check_size(quads: Collection[Quad]) -> None:
    related = sum(q.predicate.value in _RELATION_CLASSES for q in quads)
    for count, most, what in (
        (len(quads), MAX_STATEMENTS, "statements"),
        (related, MAX_RELATIONS, "relations (here:locatedAt, here:nearBy)"),
    ):
        if count > most:
            raise OntologyError(f"the ontology has {count:,} {what}; at most {most:,} would work")
    for q in quads:
        if isinstance(q.object, Literal) and len(q.object.value) > MAX_TEXT:
            raise OntologyError(
                f"{q.subject} has a text of {len(q.object.value):,} characters; "
                f"at most {MAX_TEXT:,} would work"
            )
    labels = Counter(q.subject for q in quads if q.predicate.value == v.RDFS_LABEL)
    for term, count in labels.items():
        if count > MAX_LABELS:
            raise OntologyError(f"{term} has more than {MAX_LABELS} labels")


def _check_hierarchy(quads: Iterable[Quad]) -> None:
    # each pair of a class and a superclass is a triple of the map
    parents = _parents(quads)
    if len(parents) > MAX_CLASSES:
        raise OntologyError(
            f"the ontology has {len(parents):,} classes; at most {MAX_CLASSES:,} would work"
        )
    sorter = TopologicalSorter({iri: sorted(parents[iri]) for iri in sorted(parents)})
    try:
        order = [*sorter.static_order()]
    except CycleError as error:
        cycle = [f"<{iri}>" for iri in error.args[1]]
        shown = " under ".join(cycle if len(cycle) <= 6 else [*cycle[:5], "..."])
        raise OntologyError(
            f"classes are superclasses of one another: {shown}; remove one of these "
            "rdfs:subClassOf, or keep one class for all of them"
        ) from error
    above: dict[str, set[str]] = {}
    levels: dict[str, int] = {}
    pairs = 0
    for iri in order:
        above[iri] = {iri}.union(*(above[parent] for parent in parents[iri]))
        levels[iri] = 1 + max((levels[parent] for parent in parents[iri]), default=0)
        pairs += len(above[iri])
        much = len(above[iri]) > MAX_ABOVE or pairs > MAX_SUPERCLASSES
        if levels[iri] > MAX_LEVELS or much:
            raise OntologyError(
                f"<{iri}> has too many superclasses: an ontology of at most {MAX_LEVELS} levels, "
                f"of {MAX_ABOVE} superclasses a class, and of {MAX_SUPERCLASSES:,} pairs of a "
                "class and a superclass would work"
            )


def _parents(quads: Iterable[Quad]) -> dict[str, set[str]]:
    """Every named class, by IRI, with its named superclasses as stated."""
    parents: dict[str, set[str]] = defaultdict(set)
    for q in quads:
        if not isinstance(q.subject, NamedNode) or not isinstance(q.object, NamedNode):
            continue
        child, parent = q.subject.value, q.object.value
        if q.predicate == v.RDF_TYPE and parent == v.OWL_CLASS:
            parents[child].update()
        elif q.predicate.value == v.RDFS_SUB_CLASS_OF and parent not in (v.OWL_THING, child):
            parents[child].add(parent)
            parents[parent].update()
    return dict(parents)


def _reachable(start: str, edges: Mapping[str, set[str]]) -> set[str]:
    reached, todo = {start}, [start]
    while todo:
        new = edges[todo.pop()] - reached
        reached |= new
        todo.extend(new)
    return reached


def compile_commonsense(quads: Iterable[Quad]) -> tuple[Quad, ...]:
    """The quads of graph:commonsense for an ontology's quads: closed `here:isA`, flat relations.

    Deterministic in content and order. Layout: docs/explanation/architecture.md.

    Raises:
        OntologyError: as `check_limits` and `relations`.
    """
    quads = tuple(quads)
    check_limits(quads)
    compiled = [
        Quad(NamedNode(iri), NamedNode(v.IS_A), NamedNode(above), v.COMMONSENSE_GRAPH)
        for iri, all_above in superclasses(quads).items()
        for above in all_above
    ]
    for relation in relations(quads):
        compiled.extend(_relation_quads(relation))
    return tuple(compiled)


def _relation_quads(relation: CategoryRelation) -> list[Quad]:
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, _RELATION_CLASSES[relation.kind]),
        (v.RELATION_SUBJECT, NamedNode(relation.subject)),
        (v.RELATION_TARGET, NamedNode(relation.target)),
        (v.RELATION_PROBABILITY, Literal(relation.probability)),
    ]
    sources = (NamedNode(one) if isinstance(one, str) else one for one in relation.sources)
    facts += ((v.DCT_SOURCE, source) for source in sources)
    return subject_quads(relation.iri, facts, v.COMMONSENSE_GRAPH)
