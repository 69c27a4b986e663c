"""Change draft: the net change of an update before it is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, cast

from pyoxigraph import (
    BlankNode,
    DefaultGraph,
    Literal,
    NamedNode,
    Quad,
    RdfFormat,
    Triple,
    parse,
    serialize,
)

from kg.model import vocabulary as v
from kg.model.errors import ShapeError
from kg.model.transactions import ChangeSet
from kg.rdf.quad_store import QuadStore, Subject
from kg.rdf.skolem import with_fresh_iris
from kg.store.scheduling import check_time

if TYPE_CHECKING:
    from kg.store.transactional import TransactionalStore


@dataclass(frozen=True, slots=True)
class QuadChange:
    """One operation: the quads it deletes, then those it inserts."""

    delete: tuple[Quad, ...]
    insert: tuple[Quad, ...]


@dataclass(frozen=True, slots=True)
class GroundUpdate:
    """The operations of an update; `reads` is true if they depend on the state of the map."""

    steps: tuple[QuadChange, ...]
    reads: bool = False

    def encode(self) -> tuple[dict[str, Any], bytes]:
        """A JSON-able head and N-Quads, for `decode` in another process.

        Raises ShapeError for triple terms, whose nesting another process might not survive.
        """
        quads = [quad for step in self.steps for quad in (*step.delete, *step.insert)]
        check_triple_terms(quads)
        counts = [[len(step.delete), len(step.insert)] for step in self.steps]
        body = serialize(quads, format=RdfFormat.N_QUADS) or b""
        return {"counts": counts, "reads": self.reads}, body

    @classmethod
    def decode(cls, head: dict[str, Any], body: bytes) -> GroundUpdate:
        """The update that was encoded."""
        quads = parse(body, format=RdfFormat.N_QUADS)
        return cls(tuple(_steps(head["counts"], quads)), head["reads"])


def update_text(delete: Iterable[Quad], insert: Iterable[Quad]) -> str:
    """SPARQL Update that deletes and inserts quads of named graphs, without blank nodes."""
    parts = [("DELETE DATA", tuple(delete)), ("INSERT DATA", tuple(insert))]
    return " ;\n".join(
        f"{verb} {{ {' '.join(f'GRAPH {q.graph_name} {{ {q.triple} }}' for q in quads)} }}"
        for verb, quads in parts
        if quads
    )


def why_unchanged(update: GroundUpdate, engine: QuadStore) -> str:
    """Why an update that changed nothing deleted nothing: its statement is in another graph, has
    another value, or does not exist; empty for an update without deletions."""
    deleted = [quad for step in update.steps for quad in step.delete]
    quad = next((quad for quad in deleted if not any(engine.quads_for_pattern(*quad))), None)
    if quad is None:  # none, or what is deleted is inserted again
        return ""
    subject, predicate, value, graph = quad
    triple = " ".join(map(_short, (subject, predicate, value)))
    same = engine.quads_for_pattern(subject, predicate, value, None)
    elsewhere = sorted({_short(q.graph_name) for q in islice(same, 100)})
    if elsewhere:
        return (
            f"{_short(graph)} has no statement {triple}; it is in {', '.join(elsewhere)}: "
            f"write GRAPH {elsewhere[0]} {{ ... }}"
        )
    others = engine.quads_for_pattern(subject, predicate, None, None)
    values = sorted({_short(q.object) for q in islice(others, 100)})
    found = f"; the map has the values {', '.join(values[:3])}" if values else ""
    return f"the map has no statement {triple}{found}"


def _short(term: object) -> str:
    return v.curie(term.value) if isinstance(term, NamedNode) else str(term)


def check_triple_terms(quads: Iterable[Quad]) -> None:
    """Raise ShapeError if a quad has a triple term."""
    for quad in quads:
        if isinstance(quad.object, Triple) or isinstance(quad.subject, Triple):
            raise ShapeError("the update is refused: triple terms <<( )>> are not used in maps")


def _steps(counts: Iterable[tuple[int, int]], quads: Iterator[Quad]) -> Iterator[QuadChange]:
    for deleted, inserted in counts:
        yield QuadChange(tuple(islice(quads, deleted)), tuple(islice(quads, inserted)))


Term = NamedNode | BlankNode | Literal | Triple
GraphName = NamedNode | BlankNode | DefaultGraph

_FEW: Final = 64  # facts of a subject that are kept while a change is computed


class PendingQuads:
    """A set of quads in the order of their insertion, indexed by subject and by object.

    Each lookup costs as much as the quads of one subject or object, so that a document of many
    subjects is validated in linear time.
    """

    def __init__(self) -> None:
        self._all: dict[Quad, None] = {}
        self._by_subject: dict[object, dict[Quad, None]] = {}
        self._by_object: dict[object, dict[Quad, None]] = {}

    def __len__(self) -> int:
        return len(self._all)

    def __contains__(self, quad: object) -> bool:
        return quad in self._all

    def __iter__(self) -> Iterator[Quad]:
        return iter(self._all)

    def add(self, quad: Quad) -> None:
        """Add a quad; nothing happens if it is there."""
        self._all[quad] = None
        self._by_subject.setdefault(quad.subject, {})[quad] = None
        self._by_object.setdefault(quad.object, {})[quad] = None

    def remove(self, quad: Quad) -> None:
        """Remove a quad; raises KeyError if it is not there."""
        del self._all[quad]
        for index, term in (self._by_subject, quad.subject), (self._by_object, quad.object):
            del index[term][quad]
            if not index[term]:
                del index[term]

    def about(self, subject: Subject) -> tuple[Quad, ...]:
        """The quads with a subject."""
        return tuple(self._by_subject.get(subject, ()))

    def matching(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> tuple[Quad, ...]:
        """The quads that match a pattern; None matches any term."""
        found: Iterable[Quad] = self._all
        if s is not None:
            found = self._by_subject.get(s, ())
        elif o is not None:
            found = self._by_object.get(o, ())
        return matching(found, p, o, g)


def matching(
    quads: Iterable[Quad], p: NamedNode | None, o: Term | None, g: GraphName | None
) -> tuple[Quad, ...]:
    """Those of `quads` that have a predicate, an object and a graph; None stands for any."""
    return tuple(
        quad
        for quad in quads
        if (p is None or quad.predicate == p)
        and (o is None or quad.object == o)
        and (g is None or quad.graph_name == g)
    )


class ReadState:
    """The state of a map before a change; it notes what was read of it.

    `is_changed_by` tells whether a later transaction changes anything that was read, so that a
    change can be computed while others write, and written only if it still holds.
    """

    def __init__(self, store: TransactionalStore) -> None:
        self._store = store  # not its engine, so that a closed map is released
        self._about: dict[object, tuple[Quad, ...] | None] = {}  # by subject; None: too many
        self._objects: set[object] = set()
        self._wide: set[tuple[object, object]] = set()  # predicate and graph; None: any

    def quads_for_pattern(
        self,
        s: Subject | None,
        p: NamedNode | None,
        o: Term | None,
        g: GraphName | None = None,
        /,
    ) -> Iterator[Quad]:
        """The quads that match a pattern; None matches any term."""
        check_time()
        if s is None:
            if o is None:
                self._wide.add((p, g))
            else:
                self._objects.add(o)
            return iter(self._store.engine.quads_for_pattern(s, p, o, g))
        if s not in self._about:
            # most subjects have few facts, which are asked for again and again
            found = tuple(islice(self._store.engine.quads_for_pattern(s, None, None, None), _FEW))
            self._about[s] = found if len(found) < _FEW else None
        held = self._about[s]
        if held is None:
            return iter(self._store.engine.quads_for_pattern(s, p, o, g))
        return iter(matching(held, p, o, g))

    def __contains__(self, quad: Quad) -> bool:
        about = next(self.quads_for_pattern(quad.subject, None, None), None)
        return about is not None and quad in self._store.engine  # it compares numbers by value

    def is_changed_by(self, change: ChangeSet) -> bool:
        """Whether a transaction changes facts that were read, or the ontology."""
        return any(
            quad.subject in self._about
            or quad.object in self._objects
            or quad.graph_name in (v.ONTOLOGY_GRAPH, v.COMMONSENSE_GRAPH)
            or any(
                p in (None, quad.predicate) and g in (None, quad.graph_name) for p, g in self._wide
            )
            for quads in (change.added, change.removed)
            for quad in quads
        )


class ChangeDraft:
    """Quads to add, which the graph lacks, and quads to remove, which the graph has."""

    def __init__(self, store: TransactionalStore) -> None:
        self.state = ReadState(store)
        self.added = PendingQuads()
        self.removed = PendingQuads()

    def __bool__(self) -> bool:
        return bool(self.added or self.removed)

    @property
    def engine(self) -> QuadStore:
        """The graph before the change, for reading by pattern."""
        return cast(QuadStore, self.state)

    def change(self, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
        """Apply one operation: its deletions first, then its insertions."""
        for quad in delete:
            if quad in self.added:
                self.added.remove(quad)
            elif quad in self.state:
                self.removed.add(quad)
        for quad in insert:
            if quad in self.removed:
                self.removed.remove(quad)
            elif quad not in self.state:
                self.added.add(quad)

    def apply(self, update: GroundUpdate) -> None:
        """Apply the operations of an evaluated update, in their order."""
        for step in update.steps:
            self.change(step.delete, step.insert)

    def skolemise(self) -> None:
        """Replace each blank node by a new IRI, so that every node has a name."""
        quads, self.added = self.added, PendingQuads()
        for quad in with_fresh_iris(quads):
            self.added.add(quad)

    def before(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> Iterator[Quad]:
        """Quads before the change that match a pattern; None matches any term."""
        return self.state.quads_for_pattern(s, p, o, g)

    def after(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> Iterator[Quad]:
        """Quads after the change that match a pattern; None matches any term."""
        for quad in self.state.quads_for_pattern(s, p, o, g):
            if quad not in self.removed:
                yield quad
        yield from self.added.matching(s, p, o, g)

    def facts(self, subject: Subject, predicate: str) -> tuple[Quad, ...]:
        """Facts of graph:map after the change with this subject and predicate."""
        return tuple(self.after(subject, NamedNode(predicate), None, v.MAP_GRAPH))

    def writes(self, subject: Subject, *predicates: str) -> bool:
        """Whether facts of graph:map with this subject and one of the predicates change."""
        return any(
            quad.predicate.value in predicates and quad.graph_name == v.MAP_GRAPH
            for quad in self.changed(subject)
        )

    def changed(self, subject: Subject) -> tuple[Quad, ...]:
        """Quads with this subject that are added or removed."""
        return (*self.added.about(subject), *self.removed.about(subject))

    def is_new(self, subject: Subject) -> bool:
        """Whether graph:map had no type of the subject before the change."""
        return next(self.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH), None) is None
