"""What others changed since one last looked: how a cache of the graph stays true."""

from __future__ import annotations

import threading
import weakref
from typing import Final

from pyoxigraph import NamedNode

from kg import vocabulary as v
from kg.assertions import Assertions
from kg.commits import ChangeSet
from kg.semantic_map import SemanticMap

_WATCHED: Final = {v.MAP_GRAPH, v.ASSERTIONS_GRAPH}


class OthersWrites:
    """Collects the things of graph:map that anybody but the mapper changed.

    Cheap where nothing changed; stops listening when nobody holds it any more.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._assertions = Assertions(semantic_map.base)
        self._lock = threading.Lock()
        self._touched: set[str] = set()
        reference = weakref.ref(self)

        def hear(change: ChangeSet) -> None:
            watch = reference()
            if watch is not None and change.cause.kind != "frame":
                watch._note(change)

        weakref.finalize(self, semantic_map.listen(hear))

    def take(self) -> frozenset[str]:
        """IRIs of what was changed, or pointed at by what was, since the last call."""
        if not self._touched:
            return frozenset()
        with self._lock:
            touched, self._touched = frozenset(self._touched), set()
        return touched

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
