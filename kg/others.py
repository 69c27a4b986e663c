"""What others changed since one last looked: how a cache of the graph stays true."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable
from typing import Final

from pyoxigraph import NamedNode

from kg import vocabulary as v
from kg.assertions import Assertions
from kg.commits import ChangeSet
from kg.records import ObjectRecord
from kg.semantic_map import SemanticMap

_MAP: Final = NamedNode(v.MAP_GRAPH)
_TYPE: Final = NamedNode(v.RDF_TYPE)
_WATCHED: Final = {v.MAP_GRAPH, v.ASSERTIONS_GRAPH}


class OthersWrites:
    """Collects the things of graph:map that anybody but the mapper changed.

    Cheap where nothing changed; stops listening when nobody holds it any more. A running
    `hereabouts serve` is asked at each look what others wrote. A plain SPARQL server, where other
    programs write unheard, is asked how far the map is: after a transaction of theirs every thing
    counts as changed. Who writes there without a transaction's number (a bare SPARQL update) is not
    noticed.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._assertions = Assertions(semantic_map.base)
        self._lock = threading.Lock()
        self._touched: set[str] = set()
        self._blind = not semantic_map.hears_all
        self._heard = semantic_map.sequence if self._blind else 0
        self._things = self._all_things() if self._blind else set()
        self._missed = False
        reference = weakref.ref(self)

        def hear(change: ChangeSet) -> None:
            watch = reference()
            if watch is not None:
                watch._hear(change)

        weakref.finalize(self, semantic_map.store.listen(hear))

    def take(self) -> frozenset[str]:
        """IRIs of what was changed, or pointed at by what was, since the last call."""
        self._map.catch_up()
        if self._blind:
            self._ask()
        if not self._touched:
            return frozenset()
        with self._lock:
            touched, self._touched = frozenset(self._touched), set()
        return touched

    def _ask(self) -> None:
        """Find out whether others wrote to the server, and what there is now."""
        number = self._map.sequence
        with self._lock:
            missed = self._missed or number != self._heard
            self._missed, self._heard = False, number
        if missed:
            there = self._all_things()
            with self._lock:
                self._touched |= self._things | there
                self._things = there

    def _all_things(self) -> set[str]:
        quads = self._map.engine.quads_for_pattern(None, _TYPE, None, _MAP)
        return {quad.subject.value for quad in quads if isinstance(quad.subject, NamedNode)}

    def _hear(self, change: ChangeSet) -> None:
        if self._blind:
            self._number(change)
        if self._map.is_others(change):
            self._note(change)

    def doubt(self, iris: Iterable[str]) -> None:
        """Have things count as changed."""
        with self._lock:
            self._touched |= {*iris}

    def _number(self, change: ChangeSet) -> None:
        typed = (q for q in change.added if q.predicate == _TYPE and q.graph_name == _MAP)
        with self._lock:
            # a gap: somebody was faster between our look and our commit
            self._missed |= change.sequence != self._heard + 1
            self._heard = change.sequence
            self._things |= {q.subject.value for q in typed if isinstance(q.subject, NamedNode)}

    def _note(self, change: ChangeSet) -> None:
        names = {
            term.value
            for quad in (*change.added, *change.removed)
            if getattr(quad.graph_name, "value", "") in _WATCHED
            for term in (quad.subject, quad.object)
            if isinstance(term, NamedNode)
        }
        subjects = {self._assertions.subject(name) for name in names} - {None}
        with self._lock:
            self._touched |= names | {subject for subject in subjects if subject is not None}


class PerceivedObjects(dict[str, ObjectRecord]):
    """Objects by IRI as perception believes them; `refresh` takes in what others changed."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._watch = OthersWrites(semantic_map)
        super().__init__((record.iri, record) for record in semantic_map.perceived_objects())

    def doubt(self, iris: Iterable[str]) -> None:
        """Have objects be read again at the next `refresh`, whatever is known of them."""
        self._watch.doubt(iris)

    def refresh(self) -> frozenset[str]:
        """IRIs of what others changed since the last call; cheap where nothing was."""
        touched = self._watch.take()
        if not touched:
            return touched
        found = {record.iri: record for record in self._map.perceived_objects(touched)}
        for iri in touched - found.keys():
            self.pop(iri, None)
        self.update(found)
        return touched
