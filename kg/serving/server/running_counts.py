"""Running counts of a served map: number of objects, last change of each graph.

Each change set updates them without queries. After a change of the hierarchy of categories the
objects are counted again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from pyoxigraph import BlankNode, NamedNode, Quad, Triple

from kg.maps.facts.object_filters import subcategories
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.transactions import ChangeSet

_Typed = tuple[NamedNode | BlankNode | Triple, object]  # a thing and a class

_IS_A: Final = NamedNode(v.IS_A)
_OBJECT: Final = NamedNode(v.OBJECT)


class RunningCounts:
    """Counts of one map from construction until `stop`; safe from any thread."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        with semantic_map.hold():
            self._begun = semantic_map.sequence
            self._changed: dict[NamedNode, int] = {}
            self._stale = False
            self._recount()
            self._stop: Callable[[], None] | None = semantic_map.subscriptions.listen(
                self._on_commit
            )

    @property
    def objects(self) -> int:
        """Number of things with a category of objects."""
        if self._stale:
            with self._map.hold():
                self._recount()
                self._stale = False
        return self._objects

    def changed(self, graph: NamedNode) -> int:
        """The last transaction that changed a graph, or the first one that was counted."""
        return self._changed.get(graph, self._begun)

    def stop(self) -> None:
        """Unsubscribe from the map."""
        if self._stop is not None:
            self._stop()
            self._stop = None

    def _on_commit(self, change: ChangeSet) -> None:
        quads = (*change.added, *change.removed)
        for graph in {quad.graph_name for quad in quads}:
            if isinstance(graph, NamedNode):
                self._changed[graph] = change.sequence
        if any(quad.predicate in (v.RDF_TYPE, _IS_A) for quad in quads):
            self._changed[v.INFERRED_GRAPH] = change.sequence
        kinds = {q.subject for q in quads if q.predicate == _IS_A and q.object == _OBJECT}
        if kinds:
            # the categories of objects have changed
            self._stale = True
        else:
            self._objects += self._more(change)

    def _more(self, change: ChangeSet) -> int:
        """The change of the number of objects by a change set that leaves categories unchanged."""
        added, removed = _types(change.added), _types(change.removed)
        more = 0
        for subject in {s for s, _ in added | removed}:
            held = self._map.engine.quads_for_pattern(subject, v.RDF_TYPE, None, v.MAP_GRAPH)
            now = {(subject, quad.object) for quad in held}
            more += self._counts(now) - self._counts((now | removed) - added, subject)
        return more

    def _counts(self, types: Iterable[_Typed], about: object = None) -> bool:
        return any(
            kind in self._kinds and (about is None or subject == about) for subject, kind in types
        )

    def _recount(self) -> None:
        engine = self._map.engine
        self._kinds = frozenset(map(NamedNode, subcategories(engine, v.OBJECT)))
        self._objects = len(
            {
                quad.subject
                for kind in self._kinds
                for quad in engine.quads_for_pattern(None, v.RDF_TYPE, kind, v.MAP_GRAPH)
            }
        )


def _types(quads: Iterable[Quad]) -> set[_Typed]:
    return {
        (q.subject, q.object)
        for q in quads
        if q.predicate == v.RDF_TYPE and q.graph_name == v.MAP_GRAPH
    }
