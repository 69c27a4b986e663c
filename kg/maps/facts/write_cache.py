"""Facts that the frame writer owns, and a cache of them by subject.

The writer deletes owned facts that no record has any more; it keeps all others, which persons
wrote. The cache has the state after one transaction. The writer's own transactions are applied to
it; a transaction of another writer clears it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pyoxigraph import NamedNode, Quad

from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.spatial_relations import OF_NODE, OF_OBJECT
from kg.model import vocabulary as v
from kg.model.transactions import ChangeSet
from kg.store.transactional import TransactionalStore

_STRUCTURAL = {
    *(v.PLACE, v.BOT_SPACE, v.ROBOT, v.PLACE_BELIEF, v.SOSA_OBSERVATION, v.RECORDING),
    *(v.FLOOR_TILE, v.DOOR, v.SPATIAL_RELATION, v.LABEL_BELIEF, v.DEPARTED_OBJECT),
    *(v.SEARCH, v.LOOK, v.OBSTACLE),
}
#: of objects, departed ones too, and places, with their parts
_OWN = {
    *(v.RDF_TYPE.value, v.RDFS_LABEL, v.X, v.Y, v.Z, v.IN_CELL, v.IN_PLACE),
    *(v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX, v.VIEW_COUNT, v.HAS_BELIEF, v.OF_CATEGORY, v.BELIEF),
    *(v.OUTLINE, v.FROM_FLOOR, v.BOT_ADJACENT_ZONE),
    *(v.VIEWED_SHARE, v.CLOSELY_VIEWED_SHARE, v.LAST_VIEWED),
    *(v.SCENE_BELIEF, v.TOLD_BY),
    *(v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.FIRST_SEEN, v.LAST_SEEN, v.EXPLAINED_BY),
    *(v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z, v.YAW, v.DEVIATION),
    *(v.SOSA_FEATURE, v.SOSA_RESULT_TIME, v.FRAME, v.FROM_RECORDING, v.BOX, v.SCORE, v.MODEL),
    *(v.HAS_LABEL_BELIEF, v.LABEL_PROBABILITY, v.FOUND_GONE, v.PEAK_EXISTENCE),
    *(*OF_OBJECT, *OF_NODE),
}
MAX_SUBJECTS: Final = 4096  # subjects kept: some 20 MB


def is_owned(quad: Quad, codec: RecordCodec) -> bool:
    """Whether the writer owns a fact of an object or a place, or the type of any thing."""
    if quad.predicate != v.RDF_TYPE:
        return quad.predicate.value in _OWN
    kind = getattr(quad.object, "value", "")
    return kind in _STRUCTURAL or codec.catalogue.by_iri(kind) is not None


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
