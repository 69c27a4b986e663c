"""A change to the graph that is worked out but not written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, Store, Triple

from kg.store import MapStore

Subject = NamedNode | BlankNode | Triple
Term = NamedNode | BlankNode | Literal | Triple
GraphName = NamedNode | BlankNode | DefaultGraph


class Pending:
    """What is to be added and removed, against the graph as it is: never what changes nothing."""

    def __init__(self, store: MapStore) -> None:
        self._store = store  # not its engine: a closed map must be let go of
        self.added: dict[Quad, None] = {}
        self.removed: dict[Quad, None] = {}

    def __bool__(self) -> bool:
        return bool(self.added or self.removed)

    @property
    def engine(self) -> Store:
        """The graph as it is."""
        return self._store.native

    def change(self, delete: Iterable[Quad], insert: Iterable[Quad]) -> None:
        """Take in one operation: its deletions first, then its insertions."""
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

    def before(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> Iterator[Quad]:
        """Quads of the graph as it is; None is any."""
        return iter(self._store.engine.quads_for_pattern(s, p, o, g))

    def after(
        self, s: Subject | None, p: NamedNode | None, o: Term | None, g: GraphName | None
    ) -> Iterator[Quad]:
        """Quads of the graph as it will be; None is any."""
        for quad in self._store.engine.quads_for_pattern(s, p, o, g):
            if quad not in self.removed:
                yield quad
        for quad in tuple(self.added):
            if (
                (s is None or quad.subject == s)
                and (p is None or quad.predicate == p)
                and (o is None or quad.object == o)
                and (g is None or quad.graph_name == g)
            ):
                yield quad
