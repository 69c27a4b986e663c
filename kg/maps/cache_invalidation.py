"""Invalidation of cached objects after commits by other writers."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable
from typing import Final

from pyoxigraph import NamedNode

from kg.maps.facts.assertions import Assertions
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import ObjectRecord
from kg.model.transactions import ChangeSet

_WATCHED: Final = {v.MAP_GRAPH.value, v.ASSERTIONS_GRAPH.value}


class ExternalChanges:
    """Collects the things of graph:map that writers other than the mapper changed.

    Garbage collection unsubscribes it. `take` requests the changes from a running `hereabouts
    serve`.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._assertions = Assertions(semantic_map.base)
        self._lock = threading.Lock()
        self._touched: set[str] = set()
        self._restored = False
        reference = weakref.ref(self)

        def notify(change: ChangeSet) -> None:
            watch = reference()
            if watch is not None:
                watch._on_commit(change)

        weakref.finalize(self, semantic_map.store.listen(notify))

    def take(self) -> frozenset[str]:
        """IRIs of subjects and objects of the quads that changed since the last call."""
        self._map.subscriptions.catch_up()
        if not self._touched:
            return frozenset()
        with self._lock:
            touched, self._touched = frozenset(self._touched), set()
        return touched

    def take_restored(self) -> bool:
        """Whether a past state of the map was restored since the last call."""
        with self._lock:
            restored, self._restored = self._restored, False
        return restored

    def _on_commit(self, change: ChangeSet) -> None:
        if self._map.subscriptions.is_external(change):
            self._add_touched(change)

    def invalidate(self, iris: Iterable[str]) -> None:
        """Count things as changed."""
        with self._lock:
            self._touched |= {*iris}

    def _add_touched(self, change: ChangeSet) -> None:
        names = {
            term.value
            for quad in (*change.added, *change.removed)
            if getattr(quad.graph_name, "value", "") in _WATCHED
            for term in (quad.subject, quad.object)
            if isinstance(term, NamedNode)
        }
        subjects = {self._assertions.subject(name) for name in names} - {None}
        with self._lock:
            self._restored |= change.cause.kind == "restore"
            self._touched |= names | {subject for subject in subjects if subject is not None}


class PerceivedObjects(dict[str, ObjectRecord]):
    """Perceived objects by IRI; `refresh` reads changed objects again."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._watch = ExternalChanges(semantic_map)
        super().__init__((record.iri, record) for record in semantic_map.perceived.objects())

    def invalidate(self, iris: Iterable[str]) -> None:
        """Mark objects to be read again at the next `refresh`."""
        self._watch.invalidate(iris)

    def refresh(self) -> frozenset[str]:
        """IRIs of things that others changed since the last call; cheap without changes."""
        touched = self._watch.take()
        if not touched:
            return touched
        found = {record.iri: record for record in self._map.perceived.objects(touched)}
        for iri in touched - found.keys():
            self.pop(iri, None)
        self.update(found)
        return touched
