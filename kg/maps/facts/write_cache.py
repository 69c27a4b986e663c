"""Write cache: recently read or written quads of graph:map, by subject.

It holds as of one transaction: the writer's own transactions are applied to it, and it is cleared
after a transaction of another writer. With a shared server, whose other writers are not observed,
nothing is cached.
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
        self._at: int | None = None  # the transaction after which it was read

    def catch_up(self) -> int | None:
        """Drop what another writer may have changed; returns the transaction as of which it holds.

        None where that is not known.
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
