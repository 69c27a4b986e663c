"""Flushing: a thread that writes an open store to disk every few seconds."""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from typing import Protocol

from kg.model.errors import GraphError
from kg.store.process_memory import TRIM_EVERY, trim_heap

FLUSH_EVERY = 3.0  # [s]


class Flushable(Protocol):
    """A store that can be flushed."""

    @property
    def sequence(self) -> int:
        """The number of the last transaction."""

    def flush(self) -> None:
        """Write everything to disk; raises GraphError on failure."""


class Flusher:
    """Flushes a store until it is stopped, or until nobody holds the store any more.

    It also returns free memory to the system while the store is written.
    """

    def __init__(self, store: Flushable) -> None:
        self._stop = threading.Event()
        # a weak reference, so that an unreferenced store is freed although never closed
        reference = weakref.ref(store)
        self._thread = threading.Thread(
            target=_keep_flushing, args=(reference, self._stop), daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """End the thread; idempotent."""
        self._stop.set()
        self._thread.join()


def _keep_flushing(reference: weakref.ref[Flushable], stop: threading.Event) -> None:
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
