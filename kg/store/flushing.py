"""Flushing: a thread that writes an open store to disk every few seconds."""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING

from kg.model.errors import GraphError
from kg.store.process_memory import TRIM_EVERY, trim_heap

if TYPE_CHECKING:
    from kg.store.transactional import TransactionalStore

FLUSH_EVERY = 3.0  # [s]


def keep_flushing(store: TransactionalStore) -> Callable[[], None]:
    """Flush a store every few seconds, in a thread; returns a function that ends the thread.

    The thread also ends when nobody holds the store any more. It returns free memory to the system
    while the store is written.
    """
    # a weak reference, so that an unreferenced store is freed although never closed
    reference, stop = weakref.ref(store), threading.Event()
    thread = threading.Thread(target=_flush_until, args=(reference, stop), daemon=True)
    thread.start()

    def end() -> None:
        stop.set()
        thread.join()

    return end


def _flush_until(reference: weakref.ref[TransactionalStore], stop: threading.Event) -> None:
    trimmed, written = time.monotonic(), 0
    while not stop.wait(FLUSH_EVERY):
        store = reference()
        if store is None:
            return
        with contextlib.suppress(GraphError):  # the next commit, or closing, reports it
            store.flush()
        sequence = store.sequence
        del store
        if sequence != written and time.monotonic() - trimmed > TRIM_EVERY:
            trim_heap()
            trimmed, written = time.monotonic(), sequence
