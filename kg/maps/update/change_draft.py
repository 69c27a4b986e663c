"""Change draft: the net change of an update before it is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, Store, Triple

from kg.maps.update.ground_update import GroundUpdate
from kg.model import vocabulary as v
from kg.rdf.quad_store import Subject
from kg.rdf.skolem import with_fresh_iris

if TYPE_CHECKING:
    from kg.store.transactional import TransactionalStore

Term = NamedNode | BlankNode | Literal | Triple
GraphName = NamedNode | BlankNode | DefaultGraph


class PendingQuads:
    """A set of quads in the order of their insertion, indexed by subject and by object.

    Each lookup costs as much as the quads of one subject or object, so that a document of many
    subjects is validated in linear time.
    """

    def __init__(self) -> None:
        self._all: dict[Quad, None] = {}
        self._by_subject: dict[Term, dict[Quad, None]] = {}
        self._by_object: dict[Term, dict[Quad, None]] = {}

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
        return tuple(
            quad
            for quad in found
            if (p is None or quad.predicate == p)
            and (o is None or quad.object == o)
            and (g is None or quad.graph_name == g)
        )


class ChangeDraft:
    """Quads to add, which the graph lacks, and quads to remove, which the graph has."""

    def __init__(self, store: TransactionalStore) -> None:
        self._store = store  # not its engine, so that a closed map is released
        self.added = PendingQuads()
        self.removed = PendingQuads()

    def __bool__(self) -> bool:
        return bool(self.added or self.removed)

    @property
    def engine(self) -> Store:
        """The graph before the change."""
        return self._store.native

    def change(self, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
        """Apply one operation: its deletions first, then its insertions."""
        for quad in delete:
            if quad in self.added:
                self.added.remove(quad)
            elif quad in self._store.engine:
                self.removed.add(quad)
        for quad in insert:
            if quad in self.removed:
                self.removed.remove(quad)
            elif quad not in self._store.engine:
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
        return iter(self._store.engine.quads_for_pattern(s, p, o, g))

    def after(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> Iterator[Quad]:
        """Quads after the change that match a pattern; None matches any term."""
        for quad in self._store.engine.quads_for_pattern(s, p, o, g):
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
