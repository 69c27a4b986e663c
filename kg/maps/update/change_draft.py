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


class ChangeDraft:
    """Quads to add, which the graph lacks, and quads to remove, which the graph has."""

    def __init__(self, store: TransactionalStore) -> None:
        self._store = store  # not its engine, so that a closed map is released
        self.added: dict[Quad, None] = {}
        self.removed: dict[Quad, None] = {}

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
                del self.added[quad]
            elif quad in self._store.engine:
                self.removed[quad] = None
        for quad in insert:
            if quad in self.removed:
                del self.removed[quad]
            elif quad not in self._store.engine:
                self.added[quad] = None

    def apply(self, update: GroundUpdate) -> None:
        """Apply the operations of an evaluated update, in their order."""
        for step in update.steps:
            self.change(step.delete, step.insert)

    def skolemise(self) -> None:
        """Replace each blank node by a new IRI, so that every node has a name."""
        self.added = dict.fromkeys(with_fresh_iris(self.added))

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
        for quad in tuple(self.added):
            if all(
                term is None or term == own for term, own in zip((s, p, o, g), quad, strict=True)
            ):
                yield quad

    def facts(self, subject: Subject, predicate: str) -> tuple[Quad, ...]:
        """Facts of graph:map after the change with this subject and predicate."""
        return tuple(self.after(subject, NamedNode(predicate), None, v.MAP_GRAPH))

    def writes(self, subject: Subject, *predicates: str) -> bool:
        """Whether facts of graph:map with this subject and one of the predicates change."""
        return any(
            quad.subject == subject
            and quad.predicate.value in predicates
            and quad.graph_name == v.MAP_GRAPH
            for quad in (*self.added, *self.removed)
        )

    def is_new(self, subject: Subject) -> bool:
        """Whether graph:map had no type of the subject before the change."""
        return next(self.before(subject, v.RDF_TYPE, None, v.MAP_GRAPH), None) is None
