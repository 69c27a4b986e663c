"""Past states: the map right after a transaction, replayed from the log into a store in memory.

A replay loads all facts of that moment: about 0.1 s for a map of a thousand objects with a million
observations. The last states are cached; the state after a transaction is immutable. The log has no
key frames of ontology and common sense: their past is the present with later changes undone.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from pyoxigraph import Quad, RdfFormat, Store

from kg.history.storage.change_lines import quads_of
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.rdf.quad_store import QuadStore
from kg.store.transaction_quads import sequence_quad, stored_sequence
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types

MAX_CACHED: Final = 300_000  # facts of all cached states together; about 150 MB


def replay(log: HistoryLog, present: QuadStore, sequence: int) -> Store:
    """A store of all facts of the map right after the transaction `sequence`.

    `present` holds the state of now, or after any later transaction. Raises HistoryError if the
    moment is not kept, or is dropped meanwhile.
    """
    store, text = Store(), b"\n".join(log.facts(sequence))
    if b"_:" in text:  # a bulk load renames blank nodes
        store.bulk_extend(quads_of(text.splitlines()))
    else:
        store.bulk_load(text, RdfFormat.N_QUADS, lenient=True)
    store.bulk_extend(background_at(log, present, sequence))
    if sequence:
        store.add(sequence_quad(sequence))
    complete_types(store)
    log.check_kept(sequence)
    return store


def background_at(log: HistoryLog, engine: QuadStore, sequence: int) -> set[Quad]:
    """The quads of ontology and common sense after the transaction `sequence`.

    `engine` holds the present state, or any state since `sequence`; it may be written meanwhile.
    """
    quads = {q for graph in BACKGROUND for q in engine.quads_for_pattern(None, None, None, graph)}
    # the log is read after the engine, so that it covers every change in the engine
    for quad, present in background_changes(log, sequence).items():
        (quads.add if present else quads.discard)(quad)
    return quads


def background_changes(log: HistoryLog, sequence: int) -> dict[Quad, bool]:
    """Quads of ontology and common sense that changed after `sequence`; True: present then.

    The first change of a quad decides, so that the result does not depend on the number of later
    changes in an engine.
    """
    present: dict[Quad, bool] = {}
    for change in log.change_lines(sequence, log.last, background=True):
        for side, before in zip(change, (True, False), strict=True):
            for quad in quads_of(side):
                present.setdefault(quad, before)
    return present


class PastStates:
    """Cache of the most recently used past states of one map; safe from several threads.

    `capacity` is the maximum number of facts of all states together; the last state is always kept.
    """

    def __init__(self, capacity: int = MAX_CACHED) -> None:
        self._capacity = capacity
        self._states: OrderedDict[int, tuple[Store, int]] = OrderedDict()  # with their sizes
        self._lock = threading.Lock()

    def at(self, log: HistoryLog, present: QuadStore, sequence: int) -> Store:
        """The state right after `sequence`, from the cache or replayed; raises as `replay`."""
        log.check_kept(sequence)
        with self._lock:  # a waiting thread then finds the state in the cache
            cached = self._states.pop(sequence, None)
            if cached is None:
                if self._size() > self._capacity:
                    self._states.clear()  # two large states may not fit into memory
                store = replay(log, present, sequence)
                cached = store, len(store)
            # a transaction that the store does not hold yet may still be withdrawn
            if sequence <= stored_sequence(present):
                self._states[sequence] = cached
                while len(self._states) > 1 and self._size() > self._capacity:
                    self._states.popitem(last=False)
            return cached[0]

    def _size(self) -> int:
        return sum(size for _, size in self._states.values())


class PastStore(TransactionalStore):
    """The read-only store of a past state, usable while its map is open."""

    def __init__(self, state: Store, sequence: int, present: Callable[[], QuadStore]) -> None:
        """`present` returns the map's engine, or raises GraphError if the map is closed."""
        super().__init__(state, where=f"#{sequence} of the past", read_only=True, lock=None)
        self._present = present

    @property
    def engine(self) -> QuadStore:
        """The state; raises GraphError after this store or its map is closed."""
        self._present()
        return super().engine
