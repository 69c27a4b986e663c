"""Past states: the map right after a transaction, replayed from the log into a store in memory.

All facts of that moment are loaded: for a map of a thousand objects with a million observations
that takes about a tenth of a second. The last states are cached; the state after a transaction is
immutable.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from pyoxigraph import RdfFormat, Store

from kg.history.replay.ontology_replay import background_at
from kg.history.storage.change_lines import quads_of
from kg.history.storage.log import HistoryLog
from kg.rdf.quad_store import QuadStore
from kg.store.transactional import TransactionalStore, sequence_quad, stored_sequence

CACHED: Final = 300_000  # facts of all cached states together; some 150 MB


def replay(log: HistoryLog, present: QuadStore, sequence: int) -> Store:
    """A store of all that the map held right after the transaction `sequence`.

    `present` holds what holds now, or after any later transaction: ontology and common sense are
    read from it, with later changes undone. Raises HistoryError where the moment is not kept, also
    where it is dropped meanwhile.
    """
    store, text = Store(), b"\n".join(log.facts(sequence))
    if b"_:" in text:  # loading in bulk gives blank nodes other names
        store.bulk_extend(quads_of(text.splitlines()))
    else:
        store.bulk_load(text, RdfFormat.N_QUADS, lenient=True)
    store.bulk_extend(background_at(log, present, sequence))
    if sequence:
        store.add(sequence_quad(sequence))
    log.check_kept(sequence)
    return store


class PastStates:
    """Cache of past states of one map: the most recently used. Safe from several threads.

    `capacity` is the maximum number of facts of its states together; the last one is always kept.
    """

    def __init__(self, capacity: int = CACHED) -> None:
        self._capacity = capacity
        self._states: OrderedDict[int, tuple[Store, int]] = OrderedDict()  # with their sizes
        self._lock = threading.Lock()

    def at(self, log: HistoryLog, present: QuadStore, sequence: int) -> Store:
        """The state right after `sequence`, cached or replayed; raises as `replay`."""
        log.check_kept(sequence)
        with self._lock:  # who waits finds it made
            cached = self._states.pop(sequence, None)
            if cached is None:
                if self._size() > self._capacity:
                    self._states.clear()  # two large ones may not fit into memory
                store = replay(log, present, sequence)
                cached = store, len(store)
            # one that the store does not hold yet may still be withdrawn
            if sequence <= stored_sequence(present):
                self._states[sequence] = cached
                self._evict()
            return cached[0]

    def _evict(self) -> None:
        while len(self._states) > 1 and self._size() > self._capacity:
            self._states.popitem(last=False)

    def _size(self) -> int:
        return sum(size for _, size in self._states.values())


class PastStore(TransactionalStore):
    """The store of a past state, for reading only, and while the map it is of is open."""

    def __init__(self, state: Store, sequence: int, present: Callable[[], QuadStore]) -> None:
        """`present` gives the map's engine, and raises GraphError where the map is closed."""
        super().__init__(state, where=f"#{sequence} of the past", read_only=True, lock=None)
        self._present = present

    @property
    def engine(self) -> QuadStore:
        """The state; raises GraphError once this or the map it is of is closed."""
        self._present()
        return super().engine
