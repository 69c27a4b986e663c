"""Write cache: recently read or written quads of graph:map, by subject.

The cache has the state after one transaction. The writer's own transactions are applied to it; a
transaction of another writer clears it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.transactions import ChangeSet
from kg.store.transactional import TransactionalStore

MAX_SUBJECTS: Final = 4096  # subjects kept: some 20 MB


class WriteCache:
    """Cached quads of graph:map, by subject, for which `owns` is true."""

    def __init__(self, store: TransactionalStore, owns: Callable[[Quad], bool]) -> None:
        self._store = store
        self._owns = owns
        self._cached: dict[object, dict[Quad, None]] = {}
        self._at: int | None = None  # the transaction whose state is cached

    def catch_up(self) -> int:
        """Clear the cache if another writer changed the map; returns its last transaction."""
        now = self._store.sequence
        if now != self._at:
            self._cached.clear()
        self._at = now
        return now

    def of(self, subject: NamedNode) -> dict[Quad, None]:
        """The quads of a subject, in a fixed order; do not modify the result."""
        cached = self._cached.pop(subject, None)
        if cached is None:
            quads = self._store.engine.quads_for_pattern(subject, None, None, v.MAP_GRAPH)
            cached = dict.fromkeys(filter(self._owns, quads))
            if len(self._cached) >= MAX_SUBJECTS:
                del self._cached[next(iter(self._cached))]
        if self._at is not None:
            self._cached[subject] = cached  # most recently used
        return cached

    def note(self, change: ChangeSet) -> None:
        """Apply a transaction of the writer itself."""
        if self._at is None or change.sequence != self._at + 1:
            self._cached.clear()
            self._at = None
            return
        for quad in change.removed:
            cached = self._cached.get(quad.subject)
            if cached is not None:
                cached.pop(quad, None)
        for quad in change.added:
            cached = self._cached.get(quad.subject)
            if cached is not None and quad.graph_name == v.MAP_GRAPH and self._owns(quad):
                cached[quad] = None
        self._at = change.sequence
