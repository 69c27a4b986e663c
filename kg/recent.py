"""What the writer lately wrote or read of graph:map, so that it need not list it every frame.

A copy of part of the store, true as of one transaction: the writer's own transactions are entered
into it, and where anybody else's has come between it is thrown away. Behind a server, where others
write unheard, nothing is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.commits import ChangeSet
from kg.store import MapStore

MOST: Final = 4096  # subjects kept: some 20 MB

_MAP: Final = NamedNode(v.MAP_GRAPH)


class RecentFacts:
    """The quads of graph:map, by subject, that `owns` admits, as the store holds them."""

    def __init__(self, store: MapStore, owns: Callable[[Quad], bool]) -> None:
        self._store = store
        self._owns = owns
        self._held: dict[NamedNode, dict[Quad, None]] = {}
        self._at: int | None = None  # the transaction it is true of

    def catch_up(self) -> int | None:
        """Forget what somebody else may have changed; the transaction it is true of from here on.

        None where that cannot be known.
        """
        now = None if self._store.shared else self._store.sequence
        if now is None or now != self._at:
            self._held.clear()
        self._at = now
        return now

    def of(self, subject: NamedNode) -> dict[Quad, None]:
        """The quads of a subject, in a fixed order; to be read only."""
        held = self._held.pop(subject, None)
        if held is None:
            quads = self._store.engine.quads_for_pattern(subject, None, None, _MAP)
            held = dict.fromkeys(filter(self._owns, quads))
            if len(self._held) >= MOST:
                del self._held[next(iter(self._held))]
        if self._at is not None:
            self._held[subject] = held  # now the last to be dropped
        return held

    def note(self, change: ChangeSet) -> None:
        """Take in a transaction of the writer's own."""
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
        if quad.graph_name != _MAP or not isinstance(quad.subject, NamedNode):
            return None
        return self._held.get(quad.subject)
