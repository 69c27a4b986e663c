"""Write cache: recently read or written quads of graph:map, by subject.

The cache has the state after one transaction. The writer's own transactions are applied to it; a
transaction of another writer clears it. Nothing is cached for a shared server, since its other
writers are not observed.
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
        self._held: dict[NamedNode, dict[Quad, None]] = {}
        self._at: int | None = None  # the transaction whose state is cached

    def catch_up(self) -> int | None:
        """Clear the cache if another writer may have changed the map.

        Returns the number of the transaction whose state the cache has; None if it is unknown.
        """
        now = None if self._store.shared else self._store.sequence
        if now is None or now != self._at:
            self._held.clear()
        self._at = now
        return now

    def of(self, subject: NamedNode) -> dict[Quad, None]:
        """The quads of a subject, in a fixed order; do not modify the result."""
        held = self._held.pop(subject, None)
        if held is None:
            quads = self._store.engine.quads_for_pattern(subject, None, None, v.MAP_GRAPH)
            held = dict.fromkeys(filter(self._owns, quads))
            if len(self._held) >= MAX_SUBJECTS:
                del self._held[next(iter(self._held))]
        if self._at is not None:
            self._held[subject] = held  # most recently used
        return held

    def note(self, change: ChangeSet) -> None:
        """Apply a transaction of the writer itself."""
        if self._at is None or change.sequence != self._at + 1:
            self._held.clear()
            self._at = None
            return
        for quad in change.removed:
            if (held := self._held_of(quad)) is not None:
                held.pop(quad, None)
        for quad in change.added:
            if (held := self._held_of(quad)) is not None and self._owns(quad):
                held[quad] = None
        self._at = change.sequence

    def _held_of(self, quad: Quad) -> dict[Quad, None] | None:
        if quad.graph_name != v.MAP_GRAPH or not isinstance(quad.subject, NamedNode):
            return None
        return self._held.get(quad.subject)
