"""Update validation: permissions per graph, SHACL on what is touched, a limit of deletions.

The size of the map does not matter: pyshacl validates the subjects whose facts change and, where a
subject changes its type, one subject for each property that refers to it. The data graph holds
their facts, the types of their neighbours and the superclasses. Violations that existed before the
update do not count.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad, Triple

from kg.knowledge.ontology.declared_terms import declared_terms, undeclared
from kg.knowledge.ontology.loading import SHAPES_FILE, superclasses
from kg.maps.facts.coordinate_frames import FRAME
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.update.change_draft import ChangeDraft, GroundUpdate
from kg.maps.update.implicit_assertions import Read, categories
from kg.model import vocabulary as v
from kg.model.errors import ProtectedError, ShapeError, UnconfirmedDeletionError
from kg.model.resources import ONTOLOGIES
from kg.rdf.findings import Finding
from kg.rdf.literals import text_of
from kg.rdf.quad_store import Subject
from kg.store.scheduling import check_time
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import inferred_changes

#: Graphs that an update may write only where its caller allows it, and the way that works instead.
PROTECTED: Final = {
    "ontology": (
        v.ONTOLOGY_GRAPH.value,
        "edit the ontology files and reload them (docs/how-to/protege.md)",
    ),
    "commonsense": (v.COMMONSENSE_GRAPH.value, "it is compiled from the ontology: edit that"),
    "history": (v.HISTORY_GRAPH.value, "the past is not rewritten"),
    "assertions": (
        v.ASSERTIONS_GRAPH.value,
        "use assert and retract, which move assertions with it",
    ),
}
_COUNTERS: Final = {v.SEQUENCE, v.NEXT_OBJECT, v.FRAMES_APPLIED, v.LAST_FRAME, v.TRANSFORM}
_SHAPED: Final = (v.MAP_GRAPH, v.DATASET_GRAPH, v.ASSERTIONS_GRAPH)
_AT_ONCE: Final = 100  # subjects: pyshacl takes quadratic time in their number
_MAX_SHOWN = 3  # violations in one message
_PLACE: Final = NamedNode(v.PLACE)


class UpdateValidator:
    """Checks updates against the shapes and the ontology of one map."""

    def __init__(self, store: TransactionalStore) -> None:
        from kg.rdf.shacl import Shapes  # takes a third of a second, which readers save

        self._store = store
        self._shapes = Shapes(ONTOLOGIES / SHAPES_FILE)

    def check_permissions(self, pending: ChangeDraft, allow: Collection[str]) -> None:
        """Raise ProtectedError if `pending` writes a protected graph that is not in `allow`."""
        closed = {iri: how for name, (iri, how) in PROTECTED.items() if name not in allow}
        for quad in (*pending.added, *pending.removed):
            graph = getattr(quad.graph_name, "value", "")
            if graph in closed:
                raise ProtectedError(
                    f"an update may not write graph:{graph.removeprefix(v.GRAPH)}: {closed[graph]}"
                )
            if graph == v.DATASET_GRAPH.value and "dataset" not in allow and _is_maintained(quad):
                raise ProtectedError(
                    f"an update may not write {_short(quad.predicate.value)} of graph:dataset: "
                    "the map maintains it"
                )

    def check_shapes(self, pending: ChangeDraft) -> None:
        """Raise ShapeError if `pending` uses an undeclared here: term or violates a shape."""
        self._check_terms(pending.added)
        focus = iter(dict.fromkeys(_focus(pending)))
        found: list[Finding] = []
        while some := dict.fromkeys(islice(focus, _AT_ONCE)):
            found += self._new_findings(some, pending)
        if found:
            messages = list({(f.focus, f.message): _message_of(f) for f in found}.values())
            more = f"; and {len(messages) - _MAX_SHOWN} more" if len(messages) > _MAX_SHOWN else ""
            raise ShapeError(f"the update is refused: {'; '.join(messages[:_MAX_SHOWN])}{more}")

    def _new_findings(self, focus: dict[Subject, None], pending: ChangeDraft) -> list[Finding]:
        """Violations after the change that the state before it does not have."""
        found = self._findings(focus, pending, after=True)
        if not found:
            return []
        before = {f.without_value() for f in self._findings(focus, pending, after=False)}
        return [finding for finding in found if finding.without_value() not in before]

    def _check_terms(self, added: Iterable[Quad]) -> None:
        for quad in added:
            for term in (quad.subject, quad.predicate, quad.object):
                if isinstance(term, Triple):
                    raise ShapeError(f"the update is refused: triple terms are not used: {term}")
                if not isinstance(term, NamedNode) or not term.value.startswith(v.HERE):
                    continue
                if term.value not in self._declared and quad.graph_name != v.ONTOLOGY_GRAPH:
                    problem = undeclared(term.value, self._declared)
                    raise ShapeError(f"the update is refused: {problem}")

    def _findings(
        self, focus: dict[Subject, None], pending: ChangeDraft, *, after: bool
    ) -> list[Finding]:
        check_time()
        quads = list(self._surroundings(focus, pending, after))
        if not quads:
            return []
        names = {getattr(subject, "value", "") for subject in focus}
        return [
            finding
            for finding in self._shapes.validate(quads, names)
            if finding.focus in names and finding.severity == "violation"
        ]

    def _surroundings(
        self, focus: dict[Subject, None], pending: ChangeDraft, after: bool
    ) -> Iterator[Quad]:
        """The data graph: facts of the focus, types of its neighbours, superclasses."""
        read = pending.after if after else pending.before
        classes: dict[str, None] = {}
        neighbours: dict[Subject, None] = {}
        for subject in focus:
            facts = [q for graph in _SHAPED for q in read(subject, None, None, graph)]
            if not self._shapes.may_target(facts):
                continue
            for quad in facts:
                yield quad
                if quad.predicate == v.RDF_TYPE and isinstance(quad.object, NamedNode):
                    classes[quad.object.value] = None
                elif isinstance(quad.object, NamedNode | BlankNode):
                    neighbours[quad.object] = None
        for node in neighbours:
            classes[node.value if isinstance(node, NamedNode) else ""] = None
            for graph in _SHAPED:
                for quad in read(node, v.RDF_TYPE, None, graph):
                    yield quad
                    classes[getattr(quad.object, "value", "")] = None
        yield from self._hierarchy(classes)

    def _hierarchy(self, classes: Iterable[str]) -> Iterator[Quad]:
        sub_class_of = NamedNode(v.RDFS_SUB_CLASS_OF)
        for iri in classes:
            for above in self._superclasses.get(iri, ()):
                if above != iri:
                    yield Quad(NamedNode(iri), sub_class_of, NamedNode(above), v.ONTOLOGY_GRAPH)

    @cached_property
    def _superclasses(self) -> dict[str, tuple[str, ...]]:
        return superclasses(
            self._store.engine.quads_for_pattern(None, None, None, v.ONTOLOGY_GRAPH)
        )

    @cached_property
    def _declared(self) -> set[str]:
        return declared_terms(self._store.engine)


def drop_inferred_types(pending: ChangeDraft, update: GroundUpdate) -> None:
    """Take the quads of graph:inferred out of a change: the store computes them.

    Raises ProtectedError where the update would delete or insert an inferred type by itself, since
    that cannot have an effect; a thing that is deleted or gets another class loses its types.
    """
    delete = [quad for quad in pending.removed if quad.graph_name == v.INFERRED_GRAPH]
    insert = [quad for quad in pending.added if quad.graph_name == v.INFERRED_GRAPH]
    pending.change(insert, delete)
    delete += _inferred_among(pending, update)
    if not delete and not insert:
        return
    changed = [q for q in (*pending.added, *pending.removed) if q.predicate == v.RDF_TYPE]
    retyped = {quad.subject for quad in changed}
    _, follow = inferred_changes(pending.engine, pending.removed, pending.added)
    for quad in delete:
        if quad.subject not in retyped:
            raise ProtectedError(_inferred_from(pending, quad))
    for quad in set(insert).difference(follow):
        raise ProtectedError(
            "an update may not write graph:inferred, which follows from the other graphs: "
            f"state {_short(text_of(quad.object))} in graph:map"
        )


def _inferred_among(pending: ChangeDraft, update: GroundUpdate) -> Iterator[Quad]:
    """The inferred types that an update deletes from graph:map, where they are not stated."""
    for step in update.steps:
        for quad in step.delete:
            if quad.predicate == v.RDF_TYPE and quad.graph_name == v.MAP_GRAPH:
                inferred = Quad(quad.subject, v.RDF_TYPE, quad.object, v.INFERRED_GRAPH)
                if inferred in pending.engine and quad not in pending.engine:
                    yield inferred


def _inferred_from(pending: ChangeDraft, quad: Quad) -> str:
    types = pending.before(quad.subject, v.RDF_TYPE, None, v.MAP_GRAPH)
    stated = sorted(_short(text_of(one.object)) for one in types)
    cause = f"is {' and '.join(stated)}" if stated else "states a subclass"
    return (
        f"{text_of(quad.subject)} is inferred to be {_short(text_of(quad.object))}, since it "
        f"{cause}: delete or change that class in graph:map, or the ontology"
    )


def _focus(pending: ChangeDraft) -> Iterator[Subject]:
    retyped: dict[Subject, None] = {}  # their types change, so facts that refer to them do
    for quad in (*pending.added, *pending.removed):
        if quad.graph_name in _SHAPED:
            yield quad.subject
            if quad.predicate == v.RDF_TYPE and quad in pending.removed:
                retyped[quad.subject] = None
    for subject in retyped:
        predicates: set[str] = set()
        # a bound, as a subject may have very many references of the same kind
        for quad in islice(pending.after(None, None, subject, v.MAP_GRAPH), 100_000):
            if quad.predicate.value not in predicates:
                predicates.add(quad.predicate.value)
                yield quad.subject


def _is_maintained(quad: Quad) -> bool:
    is_identity = quad.predicate == v.RDF_TYPE and quad.object == NamedNode(v.SEMANTIC_MAP)
    if quad.predicate.value == v.TRANSFORM and text_of(quad.subject).endswith(FRAME):
        return False  # persons state transforms between frames, the mapper those of recordings
    return is_identity or quad.predicate.value in _COUNTERS


def _short(iri: str) -> str:
    return iri.replace(v.HERE, "here:")


def _message_of(finding: Finding) -> str:
    value = f" (found {_short(finding.value)})" if finding.value else ""
    return f"{_short(finding.focus)}: {finding.message}{value}"


@dataclass(frozen=True, slots=True)
class DeletionLimit:
    """The largest deletion without confirmation; a deletion within either bound passes.

    The history can restore a deletion, but `DELETE WHERE {?s ?p ?o}` is usually a mistake. Objects
    and places are counted, not triples.
    """

    share: float = 0.1  # of all objects and places of the map, 0 to 1
    count: int = 10  # objects and places together


def check_confirmed(pending: ChangeDraft, facts: RecordCodec, limit: DeletionLimit) -> None:
    """Raise UnconfirmedDeletionError if `pending` removes more than `limit`."""
    lost = len(removed_things(pending, facts))
    if lost <= limit.count:
        return
    # no local variable for the iterator: the traceback would take it to another thread
    total = len(things_in(pending.before(None, v.RDF_TYPE, None, v.MAP_GRAPH), facts))
    if lost > limit.share * total:
        raise UnconfirmedDeletionError(
            f"this would delete {lost} of {total} objects and places, and nothing was written; "
            "confirm it with --yes (over HTTP the header Here-Confirm: delete, in Python "
            "confirmed=True), or delete fewer"
        )


def removed_things(pending: ChangeDraft, facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places that the change removes."""
    before = things_in(pending.removed, facts)
    return frozenset(s for s in before if not _is_thing(pending.after, facts, s))


def added_things(pending: ChangeDraft, facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places that the change adds."""
    after = things_in(pending.added, facts)
    return frozenset(s for s in after if not _is_thing(pending.before, facts, s))


def things_in(quads: Iterable[Quad], facts: RecordCodec) -> frozenset[Subject]:
    """Objects and places in `quads`: subjects that have such a type in graph:map."""
    return frozenset(
        quad.subject
        for quad in quads
        if quad.predicate == v.RDF_TYPE
        and quad.graph_name == v.MAP_GRAPH
        and (quad.object == _PLACE or facts.catalogue.by_iri(getattr(quad.object, "value", "")))
    )


def is_place(read: Read, facts: RecordCodec, subject: Subject) -> bool:
    """Whether a subject is a place in the state that `read` reads."""
    types = {quad.object for quad in read(subject, v.RDF_TYPE, None, v.MAP_GRAPH)}
    if _PLACE in types or not isinstance(subject, NamedNode):
        return _PLACE in types
    return bool(categories(read, facts, subject, "place"))


def _is_thing(read: Read, facts: RecordCodec, subject: Subject) -> bool:
    return bool(things_in(read(subject, v.RDF_TYPE, None, v.MAP_GRAPH), facts))
