"""Keep Python's own housekeeping out of the way of a live map."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

LEFT: Final = 500_000  # objects that may outlive their collections before one goes through all
ROUNDS: Final = 100  # collections between two looks at how many those are


@contextmanager
def settled() -> Iterator[None]:
    """For the length of a block, spare from garbage collection what has been there for a while.

    A full collection goes through every object there is: 60 to 200 ms, which is several frames, for
    libraries and ontologies that stay anyway, and for the facts a writer keeps at hand, which go
    without it. For programs that write a map live, once it is open. Rings of objects that were
    alive at two collections in a row stay behind; when many have, all are gone through once.
    """
    gc.collect()
    gc.freeze()
    housekeeping = _Housekeeping()
    gc.callbacks.append(housekeeping)
    try:
        yield
    finally:
        gc.callbacks.remove(housekeeping)
        gc.unfreeze()


class _Housekeeping:
    """Called by the collector around each collection."""

    def __init__(self) -> None:
        self._spared = gc.get_freeze_count()
        self._rounds = 0
        self._thorough = False

    def __call__(self, phase: str, info: Mapping[str, int]) -> None:
        if phase == "start" or info["generation"] == 0:
            return
        if self._thorough and info["generation"] < 2:
            return  # all are among the old ones by now, and their turn comes next
        gc.freeze()
        self._rounds += 1
        if self._thorough:
            self._thorough, self._spared = False, gc.get_freeze_count()
        elif self._rounds % ROUNDS == 0 and gc.get_freeze_count() > self._spared + LEFT:
            self._thorough = True
            gc.unfreeze()
